#include "proto/message_checksum.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "google/protobuf/unknown_field_set.h"
#include <grpcpp/support/slice.h>

#include "core/base/coding.h"
#include "core/base/crc32c.h"

namespace isoscope::proto {
namespace {

constexpr std::size_t kChecksumBytes = 4;
// Marks a damaged message: a field with this number, which no message has.
constexpr int kDamagedField = 536'870'911;  // the highest number

// Returns true if the buffer begins with the checksum of the rest.
bool HasChecksum(grpc::ByteBuffer* buffer) {
  grpc::ProtoBufferReader reader(buffer);
  if (!reader.status().ok()) {
    return false;
  }
  std::array<char, kChecksumBytes> stored{};
  std::size_t stored_size = 0;
  std::uint32_t crc = 0;
  const void* piece = nullptr;
  int size = 0;
  while (reader.Next(&piece, &size)) {
    const char* bytes = static_cast<const char*>(piece);
    const char* const end = bytes + size;
    while (stored_size < kChecksumBytes && bytes != end) {
      stored[stored_size++] = *bytes++;
    }
    crc = base::ExtendCrc32c(crc, bytes, static_cast<std::size_t>(end - bytes));
  }
  return stored_size == kChecksumBytes &&
         base::LoadLittleEndian<std::uint32_t>(stored.data()) == crc;
}

}  // namespace

void PrependChecksum(grpc::ByteBuffer* buffer) {
  std::vector<grpc::Slice> slices;
  buffer->Dump(&slices);  // shares the bytes
  std::uint32_t crc = 0;
  for (const grpc::Slice& slice : slices) {
    crc = base::ExtendCrc32c(crc, slice.begin(), slice.size());
  }
  std::array<char, kChecksumBytes> checksum{};
  base::StoreLittleEndian(crc, checksum.data());
  slices.insert(slices.begin(), grpc::Slice(checksum.data(), checksum.size()));
  grpc::ByteBuffer checked(slices.data(), slices.size());
  buffer->Swap(&checked);
}

void ParseChecked(grpc::ByteBuffer* buffer, google::protobuf::Message* message) {
  bool is_whole = buffer != nullptr && HasChecksum(buffer);
  if (is_whole) {
    grpc::ProtoBufferReader reader(buffer);
    is_whole = reader.Skip(kChecksumBytes) && message->ParseFromZeroCopyStream(&reader);
  }
  if (buffer != nullptr) {
    buffer->Clear();
  }
  if (!is_whole) {
    message->Clear();
    message->GetReflection()->MutableUnknownFields(message)->AddVarint(kDamagedField, 0);
  }
}

absl::Status CheckIntact(const google::protobuf::Message& message) {
  const google::protobuf::UnknownFieldSet& unknown =
      message.GetReflection()->GetUnknownFields(message);
  const bool is_damaged = !unknown.empty() && unknown.field(0).number() == kDamagedField;
  return is_damaged ? DamagedError() : absl::OkStatus();
}

absl::Status DamagedError() {
  return absl::UnavailableError(
      "a message between coordinator and agent was damaged on its way (its CRC-32C is missing or "
      "differs), or the other side is of an older version: try again; if it goes on, update both "
      "sides, and use TLS or look at the network");
}

}  // namespace isoscope::proto
