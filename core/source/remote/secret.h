// A secret: a key, a token, a password. It has no way into a stream, a log or StrCat but Reveal().

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_SECRET_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_SECRET_H_

#include <string>
#include <utility>

namespace isoscope::source {

// A value type.
class Secret {
 public:
  Secret() = default;
  explicit Secret(std::string text) : text_(std::move(text)) {}

  // For the request that is sent, and for nothing else.
  [[nodiscard]] const std::string& Reveal() const { return text_; }
  [[nodiscard]] bool empty() const { return text_.empty(); }

 private:
  std::string text_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_SECRET_H_
