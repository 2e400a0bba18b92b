// Common parts of the fuzz drivers: they split an input, state invariants, and name seeds.
//
// A driver defines LLVMFuzzerTestOneInput, libFuzzer's entry, and Seeds. libFuzzer runs it with
// clang; replay_main.cc runs it with any compiler (docs/lab/fuzzing.md).

#ifndef ISOSCOPE_TESTS_FUZZ_FUZZ_INPUT_H_
#define ISOSCOPE_TESTS_FUZZ_FUZZ_INPUT_H_

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::fuzz {

// Inputs that the decoder accepts, or nearly: where mutations start. Each driver defines it.
std::vector<std::string> Seeds();

// Aborts with `promise` on standard error unless it is kept.
void Require(bool is_kept, absl::string_view promise);
// Requires that `status` is an error that its reader can act on: one of `codes`, with a message
// that holds `named`.
void RequireError(const absl::Status& status, std::initializer_list<absl::StatusCode> codes,
                  absl::string_view named = "");

// Takes an input apart from its front. Past the end all numbers are 0 and all pieces empty.
// Thread-compatible.
class Input {
 public:
  // The bytes outlive it.
  Input(const std::uint8_t* data, std::size_t size)
      : rest_(reinterpret_cast<const char*>(data), size) {}

  std::uint8_t Byte();
  // Two bytes, little-endian.
  std::uint16_t Short();
  // Eight bytes, little-endian.
  std::uint64_t Number();
  // `count` bytes, or all that are left.
  absl::string_view Take(std::size_t count);
  // A Short, and as many bytes.
  absl::string_view Piece() { return Take(Short()); }
  // All that is left.
  absl::string_view Rest() { return Take(rest_.size()); }
  [[nodiscard]] bool empty() const { return rest_.empty(); }

 private:
  absl::string_view rest_;
};

// The bytes that Input::Piece takes. At most 65535 bytes of `bytes`.
std::string MakePiece(absl::string_view bytes);

}  // namespace isoscope::fuzz

#endif  // ISOSCOPE_TESTS_FUZZ_FUZZ_INPUT_H_
