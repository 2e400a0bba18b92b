#include "tests/support/memory_failure.h"

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <new>

namespace isoscope::testing {
namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

// No object of a class: allocations come before and after any of those.
std::atomic<std::int64_t> live_count{0};
std::atomic<bool> is_armed{false};
std::atomic<bool> fails_from_there{false};
std::atomic<std::int64_t> failing_number{kNever};
std::atomic<std::int64_t> last_number{0};
thread_local int spared_depth = 0;

bool MustFail() {
  if (!is_armed.load() || spared_depth > 0) {
    return false;
  }
  const std::int64_t number = last_number.fetch_add(1) + 1;
  return number == failing_number.load() ||
         (fails_from_there.load() && number > failing_number.load());
}

void* AllocateOrNull(std::size_t size, std::size_t alignment) {
  if (MustFail()) {
    return nullptr;
  }
  void* memory = nullptr;
  if (alignment <= alignof(std::max_align_t)) {
    memory = std::malloc(size > 0 ? size : 1);  // NOLINT(cppcoreguidelines-no-malloc): operator new
  } else if (::posix_memalign(&memory, alignment, size) != 0) {
    memory = nullptr;
  }
  if (memory != nullptr) {
    live_count.fetch_add(1, std::memory_order_relaxed);
  }
  return memory;
}

void* Allocate(std::size_t size, std::size_t alignment) {
  void* const memory = AllocateOrNull(size, alignment);
  if (memory == nullptr) {
    throw std::bad_alloc();
  }
  return memory;
}

void Free(void* memory) {
  if (memory != nullptr) {
    live_count.fetch_sub(1, std::memory_order_relaxed);
    std::free(memory);  // NOLINT(cppcoreguidelines-no-malloc): operator delete
  }
}

}  // namespace

MemoryFailure::MemoryFailure(std::int64_t nth, Mode mode) {
  last_number.store(0);
  failing_number.store(nth);
  fails_from_there.store(mode == Mode::kFromThere);
  is_armed.store(true);
}

MemoryFailure::~MemoryFailure() { is_armed.store(false); }

bool MemoryFailure::has_come() const { return last_number.load() >= failing_number.load(); }

SparedFromFailure::SparedFromFailure() { ++spared_depth; }
SparedFromFailure::~SparedFromFailure() { --spared_depth; }

std::int64_t LiveAllocationCount() { return live_count.load(); }

int ForEachFailure(const std::function<bool(std::int64_t nth, MemoryFailure::Mode mode)>& run) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): tests never change their environment
  const bool has_all = std::getenv("ISOSCOPE_EVERY_ALLOCATION") != nullptr;
  constexpr std::int64_t kAlwaysUntil = 100;
  constexpr std::int64_t kTailShare = 12;
  int run_count = 0;
  for (const auto mode : {MemoryFailure::Mode::kOnce, MemoryFailure::Mode::kFromThere}) {
    std::int64_t nth = 1;
    while (run(nth, mode)) {
      ++run_count;
      nth += has_all || nth < kAlwaysUntil ? 1 : nth / kTailShare;
    }
  }
  return run_count;
}

}  // namespace isoscope::testing

using isoscope::testing::Allocate;
using isoscope::testing::AllocateOrNull;
using isoscope::testing::Free;

constexpr std::size_t kUsual = alignof(std::max_align_t);

void* operator new(std::size_t size) { return Allocate(size, kUsual); }
void* operator new[](std::size_t size) { return Allocate(size, kUsual); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return Allocate(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment) {
  return Allocate(size, static_cast<std::size_t>(alignment));
}
void* operator new(std::size_t size, const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size, kUsual);
}
void* operator new[](std::size_t size, const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size, kUsual);
}
void* operator new(std::size_t size, std::align_val_t alignment,
                   const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment,
                     const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { Free(memory); }
void operator delete[](void* memory) noexcept { Free(memory); }
void operator delete(void* memory, std::size_t /*size*/) noexcept { Free(memory); }
void operator delete[](void* memory, std::size_t /*size*/) noexcept { Free(memory); }
void operator delete(void* memory, std::align_val_t /*alignment*/) noexcept { Free(memory); }
void operator delete[](void* memory, std::align_val_t /*alignment*/) noexcept { Free(memory); }
void operator delete(void* memory, std::size_t /*size*/, std::align_val_t /*alignment*/) noexcept {
  Free(memory);
}
void operator delete[](void* memory, std::size_t /*size*/,
                       std::align_val_t /*alignment*/) noexcept {
  Free(memory);
}
void operator delete(void* memory, const std::nothrow_t& /*tag*/) noexcept { Free(memory); }
void operator delete[](void* memory, const std::nothrow_t& /*tag*/) noexcept { Free(memory); }
