// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ENUMERABLE_THREAD_SPECIFIC_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ENUMERABLE_THREAD_SPECIFIC_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "oneapi/tbb/partitioner.h"

namespace tbb {
inline namespace stand_in {

// local() orders nothing between threads.
template <typename T>
class enumerable_thread_specific {
  struct Node {
    T value;
    Node* next;  // the one before it in time
  };

 public:
  template <typename Element>  // T or const T
  class BasicIterator {
   public:
    using iterator_category = std::forward_iterator_tag;
    using value_type = T;
    using difference_type = std::ptrdiff_t;
    using pointer = Element*;
    using reference = Element&;

    BasicIterator() = default;
    explicit BasicIterator(Node* node) : node_(node) {}
    Element& operator*() const { return node_->value; }
    Element* operator->() const { return &node_->value; }
    BasicIterator& operator++() {
      node_ = node_->next;
      return *this;
    }
    BasicIterator operator++(int) {
      BasicIterator before = *this;
      ++*this;
      return before;
    }
    bool operator==(const BasicIterator& other) const { return node_ == other.node_; }

   private:
    Node* node_ = nullptr;
  };
  using iterator = BasicIterator<T>;
  using const_iterator = BasicIterator<const T>;

  // Some of the elements, for parallel_for.
  class range_type {
   public:
    class iterator {
     public:
      explicit iterator(T* const* at) : at_(at) {}
      T& operator*() const { return **at_; }
      iterator& operator++() {
        ++at_;
        return *this;
      }
      bool operator==(const iterator& other) const { return at_ == other.at_; }

     private:
      T* const* at_;
    };

    range_type(std::vector<T*> elements, std::size_t grainsize)
        : elements_(std::move(elements)), grainsize_(grainsize) {}
    range_type(range_type& other, split /*tag*/) : grainsize_(other.grainsize_) {
      const auto half = static_cast<std::ptrdiff_t>(other.elements_.size() / 2);
      elements_.assign(other.elements_.begin() + half, other.elements_.end());
      other.elements_.resize(static_cast<std::size_t>(half));
    }
    [[nodiscard]] bool empty() const { return elements_.empty(); }
    [[nodiscard]] bool is_divisible() const { return grainsize_ < elements_.size(); }
    iterator begin() const { return iterator(elements_.data()); }
    iterator end() const { return iterator(elements_.data() + elements_.size()); }

   private:
    std::vector<T*> elements_;
    std::size_t grainsize_;
  };

  enumerable_thread_specific() : make_([](Node* next) { return new Node{T(), next}; }) {}
  // `first` is called for each element if it can be; otherwise each is made from the arguments.
  template <typename First, typename... Arguments>
  requires(
      !std::is_same_v<
          std::decay_t<First>,
          enumerable_thread_specific>) explicit enumerable_thread_specific(First first,
                                                                           Arguments... arguments) {
    if constexpr (std::is_invocable_v<First>) {
      make_ = [first](Node* next) { return new Node{first(), next}; };
    } else {
      make_ = [first, arguments...](Node* next) { return new Node{T(first, arguments...), next}; };
    }
  }
  ~enumerable_thread_specific() { clear(); }
  enumerable_thread_specific(const enumerable_thread_specific&) = delete;
  enumerable_thread_specific& operator=(const enumerable_thread_specific&) = delete;

  // The calling thread's element, made by its first call.
  T& local() {
    // By id. Those of objects that are gone stay, a few bytes each.
    thread_local std::unordered_map<std::uint64_t, void*> elements;
    void*& element = elements[id_];
    if (element == nullptr) {
      Node* const node = make_(nullptr);
      node->next = newest_.load(std::memory_order_relaxed);
      while (!newest_.compare_exchange_weak(node->next, node, std::memory_order_release,
                                            std::memory_order_relaxed)) {
      }
      element = &node->value;
    }
    return *static_cast<T*>(element);
  }

  // REQUIRES: no thread calls local() meanwhile; the same for the functions below.
  void clear() {
    for (Node* node = newest_.exchange(nullptr, std::memory_order_acquire); node != nullptr;) {
      const std::unique_ptr<Node> owned(node);
      node = node->next;
    }
    id_ = NewId();
  }
  iterator begin() { return iterator(newest_.load(std::memory_order_acquire)); }
  iterator end() { return iterator(); }
  const_iterator begin() const { return const_iterator(newest_.load(std::memory_order_acquire)); }
  const_iterator end() const { return const_iterator(); }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(std::distance(begin(), end()));
  }
  range_type range(std::size_t grainsize = 1) {
    std::vector<T*> elements;
    for (T& element : *this) {
      elements.push_back(&element);
    }
    return range_type(std::move(elements), grainsize);
  }

 private:
  static std::uint64_t NewId() {
    static std::atomic<std::uint64_t> next{0};
    return next.fetch_add(1, std::memory_order_relaxed);
  }

  std::uint64_t id_ = NewId();
  std::function<Node*(Node* next)> make_;
  std::atomic<Node*> newest_{nullptr};
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_ENUMERABLE_THREAD_SPECIFIC_H_
