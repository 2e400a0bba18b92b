#include "partition-agent/shard_damage.h"

#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/retry_delay.h"
#include "rpc/unary_call.h"

namespace isoscope::agent {
namespace {

// A shard keeps the errors of this many of its files.
constexpr std::size_t kMaxFiles = 64;

bool SaysNothingOfTheFile(const absl::Status& status) {
  return absl::IsCancelled(status) || absl::IsDeadlineExceeded(status) ||
         absl::IsUnavailable(status) || absl::IsResourceExhausted(status);
}

// Whether the error says itself that it is no matter of time. Without a word of its own, the delay
// would make the reason TOO_BUSY.
bool NeverFits(const absl::Status& status) {
  return base::ReasonOf(base::WithRetryDelay(status, rpc::UnaryTask::kBusyDelay)) ==
         base::ErrorReason::kTooLarge;
}

bool IsOfSource(const absl::Status& status) {
  return base::ReasonOf(status) == base::ErrorReason::kSourceUnreadable;
}

// A caller has credentials of his own, and this is not about them.
absl::StatusCode CodeOfSource(const absl::Status& status) {
  return absl::IsUnauthenticated(status) ? absl::StatusCode::kPermissionDenied : status.code();
}

// Returns the path that begins at `begin` with a folder: behind that it ends before a blank or
// colon.
std::string PathAt(absl::string_view message, std::size_t begin, std::size_t folder_size) {
  const std::size_t end = message.find_first_of(" :,;", begin + folder_size);
  return std::string(message.substr(begin, end - begin));
}

// Returns the message with the last names of its absolute paths in place of these. A source may lie
// elsewhere than the manifest says (--allow-source RECORDED=ACTUAL).
std::string WithoutFolders(absl::string_view message) {
  constexpr absl::string_view kBefore = " (\"'=";
  constexpr absl::string_view kBehind = " :,;=)\"'";
  std::string told;
  while (!message.empty()) {
    if (message[0] == '/' && (told.empty() || absl::StrContains(kBefore, told.back()))) {
      const absl::string_view path = message.substr(0, message.find_first_of(kBehind));
      absl::StrAppend(&told, path.substr(path.rfind('/') + 1));
      message.remove_prefix(path.size());
    } else {
      told += message[0];
      message.remove_prefix(1);
    }
  }
  return told;
}

}  // namespace

void ShardDamages::AddShard(const std::string& directory, std::string dataset, int shard_index,
                            const std::string& source) {
  const base::MutexLock lock(&mutex_);
  shards_[directory] = {.dataset = std::move(dataset),
                        .shard_index = shard_index,
                        .source_folder = source.substr(0, source.rfind('/') + 1),
                        .messages = {},
                        .source_message = ""};
}

absl::Status ShardDamages::ForCaller(absl::Status status) {
  if (status.ok()) {
    return status;
  }
  std::string path;
  std::string told;  // without paths
  bool is_new = false;
  std::string dataset;
  int shard_index = 0;
  {
    const base::MutexLock lock(&mutex_);
    for (auto& [directory, entry] : shards_) {
      const std::string folder = absl::StrCat(directory, "/");
      std::size_t begin = status.message().find(folder);
      if (begin == absl::string_view::npos) {
        begin = status.message().find(absl::StrCat(directory, ":"));
      }
      if (begin == absl::string_view::npos) {
        continue;
      }
      path = PathAt(status.message(), begin, directory.size());
      told =
          absl::StrReplaceAll(status.message(), {{folder, ""}, {directory, "the shard's folder"}});
      if (entry.source_folder.size() > 1) {
        told = WithoutFolders(absl::StrReplaceAll(told, {{entry.source_folder, ""}}));
      }
      if (IsOfSource(status)) {
        is_new = entry.source_message != told;
        entry.source_message = told;
      } else if (!SaysNothingOfTheFile(status) && entry.messages.size() < kMaxFiles) {
        std::string& message = entry.messages[path];
        is_new = message != told;
        message = told;
      }
      dataset = entry.dataset;
      shard_index = entry.shard_index;
      break;
    }
  }
  if (path.empty()) {
    return status;
  }
  if (is_new) {
    base::LogWarning(
        IsOfSource(status) ? "source_unreadable" : "shard_damaged",
        {{"dataset", dataset}, {"shard", shard_index}, {"path", path}, {"status", status}});
  }
  const std::string named =
      hides_paths_ ? absl::StrCat("dataset \"", dataset, "\", shard ", shard_index, ": ", told)
                   : std::string(status.message());
  if (IsOfSource(status)) {
    absl::Status of_source(CodeOfSource(status), named);
    status.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) {
      of_source.SetPayload(url, payload);
    });
    return of_source;
  }
  if (SaysNothingOfTheFile(status)) {
    absl::Status same(status.code(), named);
    return absl::IsResourceExhausted(status) && !NeverFits(status)
               ? base::WithRetryDelay(std::move(same), rpc::UnaryTask::kBusyDelay)
               : same;
  }
  return absl::DataLossError(named);
}

void ShardDamages::Forget(const std::string& directory) {
  const base::MutexLock lock(&mutex_);
  for (auto& [folder, entry] : shards_) {
    if (absl::StartsWith(directory, folder)) {
      std::erase_if(entry.messages, [&](const auto& message) {
        return absl::StartsWith(message.first, directory);
      });
    }
  }
}

std::vector<ShardDamage> ShardDamages::damages() const {
  const base::MutexLock lock(&mutex_);
  std::vector<ShardDamage> damages;
  for (const auto& [folder, entry] : shards_) {
    if (!entry.messages.empty()) {
      damages.push_back({.dataset = entry.dataset,
                         .shard_index = entry.shard_index,
                         .message = entry.messages.begin()->second});
    }
  }
  return damages;
}

}  // namespace isoscope::agent
