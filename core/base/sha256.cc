#include "core/base/sha256.h"

#include <array>

#include "absl/strings/escaping.h"
#include <openssl/evp.h>

#include "core/base/check.h"

namespace isoscope::base {

std::string Sha256Hex(absl::string_view bytes) {
  std::array<char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  ISOSCOPE_CHECK_EQ(
      EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(digest.data()), &size,
                 EVP_sha256(), nullptr),
      1);
  return absl::BytesToHexString({digest.data(), size});
}

}  // namespace isoscope::base
