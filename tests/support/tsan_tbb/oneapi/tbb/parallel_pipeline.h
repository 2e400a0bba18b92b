// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_PIPELINE_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_PIPELINE_H_

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <type_traits>
#include <utility>

#include "oneapi/tbb/arena_threads.h"

namespace tbb {
inline namespace stand_in {

enum class filter_mode { parallel, serial_in_order };

class flow_control {
 public:
  void stop() { stopped_ = true; }
  [[nodiscard]] bool is_stopped() const { return stopped_; }

 private:
  bool stopped_ = false;
};

namespace inside {

// A filter's knowledge of its present item.
struct Item {
  flow_control control;
  std::uint64_t number = 0;                // in the order of the first filter
  std::atomic<bool>* is_failed = nullptr;  // of the pipeline: nothing waits for its turn then
};

// Lets items through one after the other, in order.
class Gate {
 public:
  // The first filter's: calls `function` and numbers what it makes.
  template <typename Function>
  auto Number(Item* item, const Function& function) {
    const std::lock_guard<std::mutex> lock(mutex_);
    item->number = next_;
    if (is_stopped_ || *item->is_failed) {
      item->control.stop();
      return decltype(function(item->control))();
    }
    auto made = function(item->control);
    is_stopped_ = item->control.is_stopped();
    if (!is_stopped_) {
      ++next_;
    }
    return made;
  }

  template <typename Function>
  auto InTurn(const Item& item, const Function& function) {
    std::unique_lock<std::mutex> lock(mutex_);
    while (next_ != item.number && !*item.is_failed) {
      turn_.wait_for(lock, std::chrono::milliseconds(10));
    }
    struct Next {
      Gate* gate;
      ~Next() {
        ++gate->next_;
        gate->turn_.notify_all();
      }
    };
    const Next next{this};
    return function();
  }

 private:
  std::mutex mutex_;
  std::condition_variable turn_;
  std::uint64_t next_ = 0;
  bool is_stopped_ = false;
};

struct Nothing {};
template <typename T>
using OrNothing = std::conditional_t<std::is_void_v<T>, Nothing, T>;

}  // namespace inside

template <typename Input, typename Output>
class filter {
 public:
  using Step =
      std::function<inside::OrNothing<Output>(inside::Item*, const inside::OrNothing<Input>&)>;

  explicit filter(Step step) : step_(std::move(step)) {}

  template <typename Next>
  filter<Input, Next> operator&(const filter<Output, Next>& next) const {
    return filter<Input, Next>([first = step_, second = next.step()](
                                   inside::Item* item, const inside::OrNothing<Input>& input) {
      const auto between = first(item, input);
      return item->control.is_stopped() ? inside::OrNothing<Next>() : second(item, between);
    });
  }
  [[nodiscard]] const Step& step() const { return step_; }

 private:
  Step step_;
};

template <typename Input, typename Output, typename Function>
filter<Input, Output> make_filter(filter_mode mode, const Function& function) {
  const auto gate = std::make_shared<inside::Gate>();
  return filter<Input, Output>(
      [gate, mode, function](inside::Item* item, const inside::OrNothing<Input>& input) {
        if constexpr (std::is_void_v<Input>) {
          return gate->Number(item, function);
        } else {
          const auto call = [&] {
            if constexpr (std::is_void_v<Output>) {
              function(input);
              return inside::Nothing();
            } else {
              return function(input);
            }
          };
          return mode == filter_mode::parallel ? call() : gate->InTurn(*item, call);
        }
      });
}

// A thread has one item at a time.
inline void parallel_pipeline(std::size_t max_tokens, const filter<void, void>& chain) {
  inside::Arena& arena = inside::Arena::Current();
  std::atomic<bool> is_failed{false};
  const auto work = [&](std::size_t /*token*/) {
    try {
      for (bool goes_on = true; goes_on;) {
        inside::Item item;
        item.is_failed = &is_failed;
        chain.step()(&item, {});
        goes_on = !item.control.is_stopped() && !is_failed;
      }
    } catch (...) {
      is_failed = true;
      throw;
    }
  };
  // A thread in the middle of an item must not wait for another one's turn.
  arena.Run(std::min(max_tokens, static_cast<std::size_t>(arena.concurrency())), work, nullptr,
            inside::Arena::Takers::kParticipants);
}

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_PARALLEL_PIPELINE_H_
