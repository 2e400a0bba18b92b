#include "core/cli/end_note.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"

namespace isoscope::cli {
namespace {

// Never destroyed: a thread may end the process while others run.
struct EndNotes {
  base::Mutex mutex;
  std::vector<std::shared_ptr<const std::string>> sentences ABSL_GUARDED_BY(mutex);
};
EndNotes& Notes() {
  static auto* const notes = new EndNotes();
  return *notes;
}

}  // namespace

EndNote::EndNote(std::string sentence)
    : sentence_(std::make_shared<const std::string>(std::move(sentence))) {
  EndNotes& all = Notes();
  const base::MutexLock lock(&all.mutex);
  all.sentences.push_back(sentence_);
}

EndNote::~EndNote() {
  if (is_kept_) {
    return;
  }
  EndNotes& all = Notes();
  const base::MutexLock lock(&all.mutex);
  all.sentences.erase(std::find(all.sentences.begin(), all.sentences.end(), sentence_));
}

std::string EndNote::OfProcess() {
  EndNotes& all = Notes();
  const base::MutexLock lock(&all.mutex);
  return all.sentences.empty() ? "" : *all.sentences.back();
}

}  // namespace isoscope::cli
