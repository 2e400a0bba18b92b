#include "core/formats/address_opening.h"

#include "absl/status/status.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxKeptAnswers = 10'000;

std::shared_ptr<KeptAnswers>& AnswersOfThread() {
  static thread_local std::shared_ptr<KeptAnswers> answers;
  return answers;
}

// Other errors may be gone when it is asked again.
bool IsLasting(const absl::Status& status) {
  return status.ok() || absl::IsNotFound(status) || absl::IsPermissionDenied(status);
}

}  // namespace

AddressOpening::AddressOpening() : is_outermost_(AnswersOfThread() == nullptr) {
  if (is_outermost_) {
    AnswersOfThread() = std::make_shared<KeptAnswers>();
  }
}

AddressOpening::~AddressOpening() {
  if (is_outermost_) {
    AnswersOfThread()->End();
    AnswersOfThread() = nullptr;
  }
}

std::shared_ptr<KeptAnswers> KeptAnswers::OfThread() { return AnswersOfThread(); }

std::optional<KeptAnswers::Answer> KeptAnswers::Find(const std::string& store,
                                                     const ObjectRead& read) const {
  const base::MutexLock lock(&mutex_);
  const auto found = answers_.find({store, read.key, read.offset, read.size});
  const bool is_wanted =
      found != answers_.end() &&
      (!found->second.ok() || static_cast<std::int64_t>(found->second->size()) <= read.max_size);
  return is_wanted ? std::optional(found->second) : std::nullopt;
}

void KeptAnswers::Keep(const std::string& store, const ObjectRead& read, const Answer& answer,
                       std::size_t max_bytes) {
  const std::size_t bytes = answer.ok() ? answer->size() : 0;
  const base::MutexLock lock(&mutex_);
  if (!has_ended_ && IsLasting(answer.status()) && bytes <= max_bytes &&
      bytes <= kMaxKeptAnswerBytes - bytes_ && answers_.size() < kMaxKeptAnswers &&
      answers_.try_emplace({store, read.key, read.offset, read.size}, answer).second) {
    bytes_ += bytes;
  }
}

void KeptAnswers::End() {
  const base::MutexLock lock(&mutex_);
  has_ended_ = true;
  answers_.clear();
}

}  // namespace isoscope::source
