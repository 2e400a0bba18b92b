// The bytes of a terminal as keys.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_KEYS_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_KEYS_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::cli {

struct Key {
  enum class Kind { kCharacter, kUp, kDown, kLeft, kRight, kHome };
  Kind kind = Kind::kCharacter;
  char character = 0;      // of kCharacter
  bool has_shift = false;  // of the others

  friend bool operator==(const Key&, const Key&) = default;
};

// Thread-compatible.
class KeyReader {
 public:
  // Returns the keys in `bytes`. A key may be split: the next call completes it. Sequences of other
  // keys, and bytes above 127, are skipped.
  std::vector<Key> Take(absl::string_view bytes);

 private:
  std::string pending_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_KEYS_H_
