#include "server/interact/exact_cost.h"

#include <algorithm>
#include <bit>

namespace isoscope::server {
namespace {

constexpr double kGiB = 1024.0 * 1024 * 1024;
// Large volumes on few cores took 1 to 4 GiB a second once their blocks were in memory.
constexpr double kFirstBytesPerSecond = kGiB;
constexpr double kMostBytesPerSecond = 8 * kGiB;
// Frames of fewer bytes apart tell nothing about a third.
constexpr double kLeastSpan = 4;

}  // namespace

void ExactCost::OnFrame(std::int64_t active_bytes, absl::Duration duration, bool is_exact) {
  if (active_bytes <= 0) {
    return;
  }
  Seen& seen = (is_exact ? exact_ : others_)[static_cast<std::size_t>(
      std::bit_width(static_cast<std::uint64_t>(active_bytes)))];
  const auto bytes = static_cast<double>(active_bytes);
  const bool is_first = seen.bytes == 0;
  seen.bytes = is_first ? bytes : (seen.bytes * 3 + bytes) / 4;
  seen.duration = is_first ? duration : (seen.duration * 3 + duration) / 4;
}

const ExactCost::Seen* ExactCost::Nearest(const Table& table, double bytes) {
  const Seen* nearest = nullptr;
  const auto distance = [&](const Seen& seen) {
    return std::max(bytes / seen.bytes, seen.bytes / bytes);
  };
  for (const Seen& seen : table) {
    if (seen.bytes > 0 && bytes <= 2 * seen.bytes &&
        (nearest == nullptr || distance(seen) < distance(*nearest))) {
      nearest = &seen;
    }
  }
  return nearest;
}

absl::Duration ExactCost::Expected(std::int64_t active_bytes) const {
  if (active_bytes <= 0) {
    return absl::ZeroDuration();
  }
  const auto bytes = static_cast<double>(active_bytes);
  if (const Seen* const exact = Nearest(exact_, bytes);
      exact != nullptr && exact->bytes <= 2 * bytes) {
    return exact->duration * (bytes / exact->bytes);
  }
  if (const Seen* const other = Nearest(others_, bytes); other != nullptr) {
    return other->duration * (bytes / other->bytes);
  }
  const Seen* least = nullptr;
  const Seen* most = nullptr;
  for (const Seen& seen : others_) {
    if (seen.bytes > 0) {
      least = least == nullptr ? &seen : least;
      most = &seen;
    }
  }
  if (most == nullptr) {
    return absl::Seconds(bytes / kFirstBytesPerSecond);
  }
  double seconds_per_byte = 1 / kFirstBytesPerSecond;
  if (most->bytes >= kLeastSpan * least->bytes) {
    seconds_per_byte = std::max(
        absl::ToDoubleSeconds(most->duration - least->duration) / (most->bytes - least->bytes),
        1 / kMostBytesPerSecond);
  }
  return most->duration + absl::Seconds((bytes - most->bytes) * seconds_per_byte);
}

}  // namespace isoscope::server
