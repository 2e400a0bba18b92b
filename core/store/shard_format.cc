#include "core/store/shard_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"

namespace isoscope::store {
namespace {

constexpr std::size_t kHeaderCrcOffset = 12;

// The CRC-32C of a header, with its own field taken as zero. The field lies inside the header, not
// at its end: the CRC-32C of bytes that end in their own CRC-32C is the same for all contents. The
// checksum of the whole file would then be useless.
std::uint32_t HeaderCrc32c(std::string header) {
  base::StoreLittleEndian(std::uint32_t{0}, header.data() + kHeaderCrcOffset);
  return base::Crc32c(header);
}

}  // namespace

std::string EncodeBinaryHeader(absl::string_view magic, const BinaryHeader& header) {
  ISOSCOPE_CHECK_EQ(magic.size(), 8u);
  std::string bytes(magic);
  bytes.reserve(kBinaryHeaderBytes);
  base::AppendLittleEndian(kBinaryVersion, &bytes);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  base::AppendLittleEndian(header.scalar_type, &bytes);
  base::AppendLittleEndian(header.entry_size, &bytes);
  base::AppendLittleEndian(header.count, &bytes);
  base::AppendLittleEndian(header.payload_crc32c, &bytes);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  base::AppendLittleEndian(header.data_size, &bytes);
  bytes.resize(kBinaryHeaderBytes, '\0');
  base::StoreLittleEndian(HeaderCrc32c(bytes), bytes.data() + kHeaderCrcOffset);
  return bytes;
}

absl::StatusOr<BinaryHeader> DecodeBinaryFile(absl::string_view magic, absl::string_view bytes,
                                              absl::string_view where) {
  if (bytes.size() < kBinaryHeaderBytes) {
    return absl::DataLossError(absl::StrFormat("%s: %d bytes, expected a header of %d", where,
                                               bytes.size(), kBinaryHeaderBytes));
  }
  if (bytes.substr(0, magic.size()) != magic) {
    return absl::DataLossError(absl::StrFormat(
        "%s: offset 0: expected the magic bytes \"%s\"; damaged or another file", where, magic));
  }
  const auto stored = base::LoadLittleEndian<std::uint32_t>(bytes.data() + kHeaderCrcOffset);
  const std::uint32_t computed = HeaderCrc32c(std::string(bytes.substr(0, kBinaryHeaderBytes)));
  if (stored != computed) {
    return absl::DataLossError(absl::StrFormat(
        "%s: header at offset 0: crc32c 0x%08x stored, 0x%08x computed", where, stored, computed));
  }
  const auto version = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 8);
  if (version > kBinaryVersion) {
    return absl::FailedPreconditionError(
        absl::StrFormat("%s: format version %d, this program reads up to %d; use a newer program",
                        where, version, kBinaryVersion));
  }
  BinaryHeader header;
  header.scalar_type = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 16);
  header.entry_size = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 20);
  header.count = base::LoadLittleEndian<std::int64_t>(bytes.data() + 24);
  header.payload_crc32c = base::LoadLittleEndian<std::uint32_t>(bytes.data() + 32);
  header.data_size = base::LoadLittleEndian<std::int64_t>(bytes.data() + 40);
  const absl::string_view payload = bytes.substr(kBinaryHeaderBytes);
  // kMaxBlockCount entries of 2^32 - 1 bytes fit 64 bits.
  if (version == 0 || header.count < 0 || header.count > volume::kMaxBlockCount ||
      static_cast<std::uint64_t>(header.count) * header.entry_size != payload.size()) {
    return absl::DataLossError(absl::StrFormat(
        "%s: version %d with %d bytes after the header, expected %d entries of %d bytes", where,
        version, payload.size(), header.count, header.entry_size));
  }
  const std::uint32_t payload_crc32c = base::Crc32c(payload);
  if (payload_crc32c != header.payload_crc32c) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes at offset %d: crc32c 0x%08x stored, 0x%08x computed", where,
                        payload.size(), kBinaryHeaderBytes, header.payload_crc32c, payload_crc32c));
  }
  return header;
}

std::string EncodeBlockIndexEntry(const BlockIndexEntry& entry) {
  std::string bytes;
  bytes.reserve(kBlockIndexEntryBytes);
  base::AppendLittleEndian(entry.block_id, &bytes);
  base::AppendLittleEndian(entry.encoding, &bytes);
  base::AppendLittleEndian(entry.offset, &bytes);
  base::AppendLittleEndian(entry.size, &bytes);
  base::AppendLittleEndian(entry.raw_size, &bytes);
  base::AppendLittleEndian(entry.crc32c, &bytes);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  return bytes;
}

BlockIndexEntry DecodeBlockIndexEntry(const char* bytes) {
  return {.block_id = base::LoadLittleEndian<volume::BlockId>(bytes),
          .encoding = base::LoadLittleEndian<std::uint32_t>(bytes + 4),
          .offset = base::LoadLittleEndian<std::int64_t>(bytes + 8),
          .size = base::LoadLittleEndian<std::uint32_t>(bytes + 16),
          .raw_size = base::LoadLittleEndian<std::uint32_t>(bytes + 20),
          .crc32c = base::LoadLittleEndian<std::uint32_t>(bytes + 24)};
}

}  // namespace isoscope::store
