#include "tests/fuzz/fuzz_input.h"

#include <algorithm>
#include <cstdlib>
#include <iostream>

#include "absl/strings/match.h"

#include "core/base/coding.h"

// Known leaks: HDF5 and ITK after a damaged file, and OpenSSL in a thread that gRPC or Asio ended.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libhdf5\nleak:libITK\nleak:libcrypto\n";
}

namespace isoscope::fuzz {

void Require(bool is_kept, absl::string_view promise) {
  if (!is_kept) {
    std::cerr << "broken promise: " << promise << std::endl;
    std::abort();
  }
}

void RequireError(const absl::Status& status, std::initializer_list<absl::StatusCode> codes,
                  absl::string_view named) {
  const bool is_expected = std::find(codes.begin(), codes.end(), status.code()) != codes.end();
  if (!is_expected || status.message().empty() || !absl::StrContains(status.message(), named)) {
    std::cerr << "the error is \"" << status << "\", and should name \"" << named << "\"\n";
    Require(false, "an error has a documented code and names its place");
  }
}

std::uint8_t Input::Byte() {
  const absl::string_view byte = Take(1);
  return byte.empty() ? std::uint8_t{0} : static_cast<std::uint8_t>(byte[0]);
}

std::uint16_t Input::Short() {
  const std::uint8_t low = Byte();
  return static_cast<std::uint16_t>(low | Byte() << 8);
}

std::uint64_t Input::Number() {
  std::uint64_t number = 0;
  for (int shift = 0; shift < 64; shift += 8) {
    number |= std::uint64_t{Byte()} << shift;
  }
  return number;
}

absl::string_view Input::Take(std::size_t count) {
  const absl::string_view taken = rest_.substr(0, count);
  rest_.remove_prefix(taken.size());
  return taken;
}

std::string MakePiece(absl::string_view bytes) {
  const absl::string_view kept = bytes.substr(0, 0xffff);
  std::string piece;
  base::AppendLittleEndian(static_cast<std::uint16_t>(kept.size()), &piece);
  piece.append(kept.data(), kept.size());
  return piece;
}

}  // namespace isoscope::fuzz
