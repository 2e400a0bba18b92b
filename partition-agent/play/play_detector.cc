#include "partition-agent/play/play_detector.h"

#include <algorithm>
#include <cstdlib>

namespace isoscope::agent {
namespace {

// The most clients that take turns. With more, unrelated frames would look like a play.
constexpr std::size_t kMaxTurns = 3;

// The way from one position to another. The first follows the last.
int WayTo(int to, int from, int count) {
  const int way = to - from;
  return std::abs(way) == count - 1 ? (way < 0 ? 1 : -1) : way;
}

PlayDetector::Guess GuessFrom(const std::vector<int>& recent, int count) {
  const int now = recent.front();
  // Whether a position was shown before that of index `turns`.
  const auto is_before = [&](int position, std::size_t turns) {
    return std::find(recent.begin() + static_cast<std::ptrdiff_t>(turns) + 1, recent.end(),
                     position) != recent.end();
  };
  for (std::size_t turns = 1; turns <= kMaxTurns && turns < recent.size(); ++turns) {
    const int stride = WayTo(now, recent[turns], count);
    const bool is_neighbour = std::abs(stride) == 1;
    const bool is_repeated =
        2 * turns < recent.size() && WayTo(recent[turns], recent[2 * turns], count) == stride;
    const bool is_third = is_neighbour && is_before((now - 2 * stride + 2 * count) % count, turns);
    if (!is_repeated && !is_third && !(is_neighbour && turns == 1)) {
      continue;
    }
    const int next = is_neighbour ? (now + stride + count) % count : now + stride;
    if (next >= 0 && next < count && next != now) {
      return {.next = next, .follows_last = turns == 1};
    }
  }
  return {};
}

}  // namespace

PlayDetector::Guess PlayDetector::Note(const std::string& look, int position, int count) {
  auto found = std::find_if(looks_.begin(), looks_.end(),
                            [&](const Look& known) { return known.name == look; });
  if (found == looks_.end()) {
    if (looks_.size() == kMaxLooks) {
      looks_.pop_back();
    }
    looks_.push_front({.name = look, .count = count, .recent = {}, .guess = {}});
    found = looks_.begin();
  }
  looks_.splice(looks_.begin(), looks_, found);
  std::vector<int>& recent = found->recent;
  if (!recent.empty() && recent.front() == position && found->count == count) {
    return found->guess;
  }
  found->count = count;
  std::erase(recent, position);
  recent.insert(recent.begin(), position);
  recent.resize(std::min(recent.size(), kMaxRecent));
  found->guess = GuessFrom(recent, count);
  return found->guess;
}

}  // namespace isoscope::agent
