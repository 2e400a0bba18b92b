// The requests and answers of a browser's connection, as HTTP/1.1 has them.

#ifndef ISOSCOPE_CORE_HTTP_PEER_MESSAGE_H_
#define ISOSCOPE_CORE_HTTP_PEER_MESSAGE_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::http {

// Names and values of a header, in order.
using PeerFields = std::vector<std::pair<std::string, std::string>>;

// Appends a field, after removing those of the same name; names ignore case.
void SetField(absl::string_view name, absl::string_view value, PeerFields* fields);

struct PeerRequest {
  std::string method = {};
  std::string target = {};
  PeerFields fields = {};
  std::string body = {};
  bool is_http_1_0 = false;
  bool has_body = false;
  bool keeps_alive = false;     // another request may follow
  bool asks_websocket = false;  // requests a WebSocket

  // Returns the value of a field that a request has once (request_rules.h), else its first value;
  // "" without it.
  [[nodiscard]] absl::string_view Field(absl::string_view name) const;
  // Returns the values of all fields of the name, with ", " between. A list may come in parts (RFC
  // 9110, 5.3).
  [[nodiscard]] std::string List(absl::string_view name) const;
  [[nodiscard]] int CountFields(absl::string_view name) const;
};

// An open file; closes it. Can be moved.
class AnswerFile {
 public:
  AnswerFile() = default;
  ~AnswerFile();
  AnswerFile(AnswerFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}
  AnswerFile& operator=(AnswerFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_, other.size_);
    return *this;
  }

  // The status has the error of the operating system as its message.
  static absl::StatusOr<AnswerFile> Open(const std::string& path);

  [[nodiscard]] bool is_open() const { return descriptor_ >= 0; }
  [[nodiscard]] int descriptor() const { return descriptor_; }
  [[nodiscard]] std::int64_t size() const { return size_; }

 private:
  int descriptor_ = -1;
  std::int64_t size_ = 0;
};

struct PeerAnswer {
  int status = 200;
  PeerFields fields = {};  // complete, with Content-Length
  std::string body = {};
  AnswerFile file = {};  // replaces `body` if it is open
};

// The bytes of an answer that are not sent yet. A file is in memory a piece at a time.
// Thread-compatible.
class UnsentAnswer {
 public:
  static constexpr std::size_t kPieceBytes = std::size_t{64} * 1024;

  explicit UnsentAnswer(PeerAnswer answer);
  // Bytes of the whole answer.
  [[nodiscard]] std::int64_t size() const {
    return static_cast<std::int64_t>(head_.size()) +
           (answer_.file.is_open() ? answer_.file.size()
                                   : static_cast<std::int64_t>(answer_.body.size()));
  }
  UnsentAnswer(const UnsentAnswer&) = delete;
  UnsentAnswer& operator=(const UnsentAnswer&) = delete;

  // Loads the next piece of the file once the last one is sent. False: the file can't be read, or
  // is shorter than before.
  bool Load();
  // The bytes to send next, of the head and after it; valid until Load. Both are empty after Load
  // if all is sent.
  [[nodiscard]] absl::string_view head() const { return unsent_head_; }
  [[nodiscard]] absl::string_view body() const { return unsent_body_; }
  // Notes that `size` more bytes are sent. REQUIRES: head and body have as many.
  void Consume(std::size_t size);

 private:
  PeerAnswer answer_;
  std::string head_;
  absl::string_view unsent_head_;
  absl::string_view unsent_body_;
  std::int64_t file_offset_ = 0;
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_PEER_MESSAGE_H_
