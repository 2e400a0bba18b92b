// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_FOR_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_FOR_H_

#include <atomic>
#include <concepts>
#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

#include "oneapi/tbb/arena_threads.h"
#include "oneapi/tbb/blocked_range.h"
#include "oneapi/tbb/partitioner.h"
#include "oneapi/tbb/task_arena.h"
#include "oneapi/tbb/task_group.h"

namespace tbb {
inline namespace stand_in {
namespace inside {

// Chunks that a loop has for each thread unless told otherwise.
inline constexpr std::size_t kChunksPerThread = 4;

template <typename... Rest>
inline constexpr bool kIsSimple = (std::is_same_v<std::decay_t<Rest>, simple_partitioner> || ...);

inline const std::atomic<bool>* FlagOf(const task_group_context& context) { return context.flag(); }
template <typename Partitioner>
const std::atomic<bool>* FlagOf(const Partitioner& /*partitioner*/) {
  return nullptr;
}

// The flag of the context among `rest`, or null.
template <typename... Rest>
const std::atomic<bool>* FlagAmong(const Rest&... rest) {
  const std::atomic<bool>* flag = nullptr;
  ((flag = FlagOf(rest) != nullptr ? FlagOf(rest) : flag), ...);
  return flag;
}

}  // namespace inside

// `rest`: a partitioner, a task_group_context, or both.
template <typename Range, typename Body, typename... Rest>
requires(!std::integral<Range>) void parallel_for(const Range& range, const Body& body,
                                                  Rest&&... rest) {
  if (range.empty()) {
    return;
  }
  inside::Arena& arena = inside::Arena::Current();
  const std::size_t enough =
      inside::kChunksPerThread * static_cast<std::size_t>(arena.concurrency());
  std::vector<Range> pieces = {range};
  for (bool splits = true; splits && (inside::kIsSimple<Rest...> || pieces.size() < enough);) {
    splits = false;
    std::vector<Range> halves;
    for (Range& piece : pieces) {
      if (piece.is_divisible()) {
        Range second(piece, split());
        halves.push_back(piece);
        halves.push_back(second);
        splits = true;
      } else {
        halves.push_back(piece);
      }
    }
    pieces = std::move(halves);
  }
  arena.Run(
      pieces.size(), [&](std::size_t i) { body(pieces[i]); }, inside::FlagAmong(rest...));
}

template <std::integral Index, typename Function, typename... Rest>
void parallel_for(Index first, Index last, const Function& function, Rest&&... rest) {
  stand_in::parallel_for(
      blocked_range<Index>(first, last),
      [&](const blocked_range<Index>& piece) {
        for (Index i = piece.begin(); i < piece.end(); ++i) {
          function(i);
        }
      },
      rest...);
}

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_FOR_H_
