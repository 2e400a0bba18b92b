// Seals bytes that a fuzzer made, so that decoders look behind the checksums.

#ifndef ISOSCOPE_TESTS_FUZZ_CORE_STORE_SEALED_BYTES_H_
#define ISOSCOPE_TESTS_FUZZ_CORE_STORE_SEALED_BYTES_H_

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>

#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"

namespace isoscope::fuzz {

// The text with the right checksum, if it has room for exactly one; else the text.
inline std::string SealedText(absl::string_view text) {
  constexpr absl::string_view kPrefix = "\"crc32c\": \"";
  std::string sealed(text);
  const std::size_t prefix = sealed.find(kPrefix.data(), 0, kPrefix.size());
  if (prefix == std::string::npos ||
      sealed.find(kPrefix.data(), prefix + 1, kPrefix.size()) != std::string::npos ||
      sealed.size() <= prefix + kPrefix.size() + 8) {
    return sealed;
  }
  sealed.replace(prefix + kPrefix.size(), 8, "00000000");
  return store::SealJson(sealed);
}

// A binary file with the entry size, scalar type and data size that stand in the header of `bytes`,
// all of its payload, and right counts and checksums. Without a whole header: `bytes`.
inline std::string SealedBinary(absl::string_view magic, absl::string_view bytes) {
  if (bytes.size() < store::kBinaryHeaderBytes) {
    return std::string(bytes);
  }
  const absl::string_view payload = bytes.substr(store::kBinaryHeaderBytes);
  store::BinaryHeader header;
  header.scalar_type = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 16);
  header.entry_size = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 20);
  header.count =
      header.entry_size == 0 ? 0 : static_cast<std::int64_t>(payload.size() / header.entry_size);
  header.payload_crc32c = base::Crc32c(payload);
  header.data_size = base::LoadLittleEndian<std::int64_t>(bytes.data() + 40);
  return store::EncodeBinaryHeader(magic, header) + std::string(payload);
}

}  // namespace isoscope::fuzz

#endif  // ISOSCOPE_TESTS_FUZZ_CORE_STORE_SEALED_BYTES_H_
