// One opening of a volume at an address: several readers look at the same metadata, each of them anew.
// While it lives, whatever small its thread reads of a store is asked for once.
//
//   {
//     const AddressOpening opening;
//     files = FilesOf(request);      asks the server
//     series = Open(request);        finds its answers
//   }                                forgets them: the next opening sees what has changed

#ifndef ISOSCOPE_CORE_FORMATS_ADDRESS_OPENING_H_
#define ISOSCOPE_CORE_FORMATS_ADDRESS_OPENING_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

inline constexpr std::size_t kMaxKeptAnswerBytes = std::size_t{4} << 20;  // of one opening

// Within another one of the thread it does nothing: the outer one keeps the answers.
class AddressOpening {
 public:
  AddressOpening();
  ~AddressOpening();
  AddressOpening(const AddressOpening&) = delete;
  AddressOpening& operator=(const AddressOpening&) = delete;

 private:
  const bool is_outermost_;
};

// The answers of an opening, for its stores. Thread-safe.
class KeptAnswers {
 public:
  using Answer = absl::StatusOr<std::string>;

  // Those of the opening of this thread; null: there is none.
  static std::shared_ptr<KeptAnswers> OfThread();

  // Not set: not kept, or more than read.max_size.
  [[nodiscard]] std::optional<Answer> Find(const std::string& store, const ObjectRead& read) const
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Keeps bytes, `max_bytes` at most, and that an object is not there, or may not be read.
  void Keep(const std::string& store, const ObjectRead& read, const Answer& answer,
            std::size_t max_bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  // Forgets all, and keeps nothing more: stores live on, and read samples.
  void End() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Key = std::tuple<std::string, std::string, std::int64_t, std::int64_t>;

  mutable base::Mutex mutex_;
  std::map<Key, Answer> answers_ ABSL_GUARDED_BY(mutex_);
  std::size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ADDRESS_OPENING_H_
