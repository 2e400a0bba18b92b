#include "core/http/peer_message.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include <boost/beast/http/status.hpp>
#include <sys/stat.h>

namespace isoscope::http {

void SetField(absl::string_view name, absl::string_view value, PeerFields* fields) {
  const auto is_named = [&](const auto& field) {
    return absl::EqualsIgnoreCase(field.first, name);
  };
  fields->erase(std::remove_if(fields->begin(), fields->end(), is_named), fields->end());
  fields->emplace_back(name, value);
}

absl::string_view PeerRequest::Field(absl::string_view name) const {
  for (const auto& [found, value] : fields) {
    if (absl::EqualsIgnoreCase(found, name)) {
      return value;
    }
  }
  return "";
}

std::string PeerRequest::List(absl::string_view name) const {
  std::string list;
  for (const auto& [found, value] : fields) {
    if (absl::EqualsIgnoreCase(found, name)) {
      absl::StrAppend(&list, list.empty() ? "" : ", ", value);
    }
  }
  return list;
}

int PeerRequest::CountFields(absl::string_view name) const {
  return static_cast<int>(std::count_if(fields.begin(), fields.end(), [&](const auto& field) {
    return absl::EqualsIgnoreCase(field.first, name);
  }));
}

AnswerFile::~AnswerFile() {
  if (descriptor_ >= 0) {
    close(descriptor_);
  }
}

absl::StatusOr<AnswerFile> AnswerFile::Open(const std::string& path) {
  const auto failed = [] { return absl::InternalError(std::generic_category().message(errno)); };
  AnswerFile file;
  file.descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file.descriptor_ < 0) {
    return failed();
  }
  struct stat found {};
  if (fstat(file.descriptor_, &found) != 0) {
    return failed();
  }
  posix_fadvise(file.descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
  file.size_ = found.st_size;
  return file;
}

UnsentAnswer::UnsentAnswer(PeerAnswer answer) : answer_(std::move(answer)) {
  namespace beast_http = boost::beast::http;
  const auto reason = beast_http::obsolete_reason(static_cast<beast_http::status>(answer_.status));
  head_ = absl::StrCat("HTTP/1.1 ", answer_.status, " ",
                       absl::string_view(reason.data(), reason.size()), "\r\n");
  for (const auto& [name, value] : answer_.fields) {
    absl::StrAppend(&head_, name, ": ", value, "\r\n");
  }
  absl::StrAppend(&head_, "\r\n");
  unsent_head_ = head_;
  if (!answer_.file.is_open()) {
    unsent_body_ = answer_.body;
  }
}

bool UnsentAnswer::Load() {
  if (!unsent_body_.empty() || !answer_.file.is_open() || file_offset_ >= answer_.file.size()) {
    return true;
  }
  answer_.body.resize(static_cast<std::size_t>(
      std::min<std::int64_t>(kPieceBytes, answer_.file.size() - file_offset_)));
  ssize_t size = 0;
  do {
    size = pread(answer_.file.descriptor(), answer_.body.data(), answer_.body.size(), file_offset_);
  } while (size < 0 && errno == EINTR);
  if (size <= 0) {
    return false;
  }
  unsent_body_ = absl::string_view(answer_.body.data(), static_cast<std::size_t>(size));
  file_offset_ += size;
  return true;
}

void UnsentAnswer::Consume(std::size_t size) {
  const std::size_t head_bytes = std::min(size, unsent_head_.size());
  unsent_head_.remove_prefix(head_bytes);
  unsent_body_.remove_prefix(size - head_bytes);
}

}  // namespace isoscope::http
