// Random draws of tests: a test draws thread counts and memory limits as it draws cameras.

#ifndef ISOSCOPE_TESTS_SUPPORT_DRAWS_H_
#define ISOSCOPE_TESTS_SUPPORT_DRAWS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <ostream>
#include <string>

#include "absl/strings/string_view.h"

#include "core/base/random.h"

namespace isoscope::testing {

// The numbers of one seed, one after another. Thread-compatible.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : seed_(seed) {}

  std::uint64_t Bits() { return base::RandomBits(seed_, next_++); }
  double Unit() { return base::RandomUnit(seed_, next_++); }
  // In [low, high].
  std::int64_t Whole(std::int64_t low, std::int64_t high) {
    return low + static_cast<std::int64_t>(Bits() % static_cast<std::uint64_t>(high - low + 1));
  }
  // In [low, high], log-uniform. REQUIRES: 0 < low <= high.
  std::size_t Size(std::size_t low, std::size_t high);
  bool OneIn(std::int64_t n) { return Whole(1, n) == 1; }
  template <typename T, std::size_t kCount>
  T OneOf(const std::array<T, kCount>& choices) {
    return choices[static_cast<std::size_t>(Whole(0, kCount - 1))];
  }

 private:
  const std::uint64_t seed_;
  std::uint64_t next_ = 0;
};

// A seed for the threads and limits of the running test. It follows from the name of the test,
// from `salt`, and from ISOSCOPE_DRAW_SEED (default: 1), which gives other draws.
std::uint64_t DrawSeed(absl::string_view salt = "");

// The threads of an arena, and the bytes of the agents in it. The defaults bound no small frame.
struct Limits {
  static constexpr std::size_t kNoMemoryLimit = std::size_t{4} << 30;

  // As agent::AgentMemory divides its limit.
  [[nodiscard]] std::size_t kept_mesh_bytes() const { return memory_limit_bytes / 16; }
  [[nodiscard]] std::size_t unused_image_bytes() const { return memory_limit_bytes / 16; }
  [[nodiscard]] std::size_t unused_layer_bytes() const { return memory_limit_bytes / 32; }
  [[nodiscard]] std::size_t read_bytes() const;

  friend std::ostream& operator<<(std::ostream& out, const Limits& limits);

  int thread_count = 2;
  std::size_t memory_limit_bytes = kNoMemoryLimit;
  // Each step of an agent computes on its own thread, as where a process has many agents.
  bool one_thread_a_step = false;
};

inline constexpr std::array<int, 5> kThreadCounts = {1, 2, 3, 8, 32};
// The CPU renderer then shades after each Add, and reads go one by one. Programs ask for
// agent::AgentMemory::kMinLimitBytes, which holds all meshes of the small volumes of tests.
inline constexpr std::size_t kLeastMemoryLimitBytes = std::size_t{1} << 12;

// Draws one of kThreadCounts, a limit from kLeastMemoryLimitBytes to none (log-uniform, and none in
// one of four), and in one of two that a step has one thread.
Limits DrawLimits(Dice* dice);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_DRAWS_H_
