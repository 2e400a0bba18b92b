// Codecs of chunks, by a table of their names. A chain of codecs turns the bytes of an object into
// the numbers of a chunk.
//
// A chain stands as it encodes: an array, codecs that make another array of it ("transpose"), one
// that makes bytes ("bytes"), and codecs of bytes ("zstd", "crc32c"). Decoding goes backwards. When
// the chain is made, each codec says what it makes of what it is given. So the size of every step
// is known before the first byte is decoded, and no step takes more memory than that.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CODEC_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CODEC_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"
#include <nlohmann/json.hpp>

#include "core/source/chunks/number_type.h"

namespace isoscope::source {

using ChunkJson = nlohmann::json;

// Numbers of an array, C order, little-endian; or bytes.
struct ChunkData {
  bool is_array = true;
  std::vector<std::int64_t> dims{};      // of an array
  NumberType type = NumberType::kUint8;  // of an array
  std::string fill{};                    // one number of an array; empty: not known
  std::int64_t size_bytes = 0;           // at most, if it is not exact
  bool is_exact = true;
};
// REQUIRES: the product of the sizes fits 63 bits.
ChunkData ArrayData(std::vector<std::int64_t> dims, NumberType type, std::string fill);

// Thread-safe.
class ChunkCodec {
 public:
  virtual ~ChunkCodec() = default;
  // Returns what was encoded. Its chain checks the sizes on both sides. DATA_LOSS: damaged; the
  // message is to follow a name and a colon.
  [[nodiscard]] virtual absl::StatusOr<std::string> Decode(std::string encoded) const = 0;
  // The same into `out`, whose memory is used again. By default Decode of a copy.
  [[nodiscard]] virtual absl::Status DecodeInto(absl::string_view encoded, std::string* out) const;
  // True if Decode returns what it is given.
  [[nodiscard]] virtual bool is_identity() const { return false; }
};

// A codec as metadata name it.
struct CodecSpec {
  std::string name;
  ChunkJson configuration = ChunkJson::object();
};

// The codecs of a list of JSON: objects with a "name" and perhaps a "configuration", or names.
// INVALID_ARGUMENT: anything else; the message is to follow a name and a colon.
absl::StatusOr<std::vector<CodecSpec>> CodecSpecsFrom(const ChunkJson& list);

class CodecChain {
 public:
  // A chain without codecs: decoded and encoded data are the same.
  CodecChain() = default;
  // `specs` in the order of encoding. `decoded`: a chunk. INVALID_ARGUMENT: an unknown codec, by
  // its name; a configuration that makes no sense; codecs of bytes before one that makes bytes, or
  // none of those; more than 32 codecs. The message is to follow a name and a colon.
  static absl::StatusOr<CodecChain> Make(absl::Span<const CodecSpec> specs, ChunkData decoded);

  // The chunk; exactly decoded().size_bytes. DATA_LOSS: damaged, or of another size. The message is
  // to follow a name and a colon.
  [[nodiscard]] absl::StatusOr<std::string> Decode(absl::string_view encoded) const;
  // The same into `out`, whose memory is used again: chunk after chunk of one thread takes none.
  [[nodiscard]] absl::Status DecodeInto(absl::string_view encoded, std::string* out) const;

  [[nodiscard]] const ChunkData& decoded() const { return stages_.front(); }
  // What the object holds: no more bytes than these.
  [[nodiscard]] const ChunkData& encoded() const { return stages_.back(); }
  // Bytes that Decode takes at most at a time, its argument and its result included.
  [[nodiscard]] std::int64_t memory_bytes() const;

 private:
  // DATA_LOSS: data have another size than the i-th stage.
  [[nodiscard]] absl::Status CheckSize(std::size_t stage, std::size_t size) const;

  std::vector<std::shared_ptr<const ChunkCodec>> codecs_;
  std::vector<std::string> names_;
  std::vector<ChunkData> stages_ = {ChunkData()};  // before the first codec, behind each
};

// ---- The rows of the table. ---------------------------------------------------------------------

// Makes a codec that encodes `*data`, and turns `*data` into what it encodes to. Errors as Make.
using MakeChunkCodec = absl::StatusOr<std::unique_ptr<ChunkCodec>> (*)(
    const ChunkJson& configuration, ChunkData* data);

struct CodecRow {
  absl::string_view name;
  MakeChunkCodec make;
};
absl::Span<const CodecRow> ArrayCodecs();   // of numbers, and those that make bytes of them
absl::Span<const CodecRow> ByteCodecs();    // of bytes
absl::Span<const CodecRow> NumberCodecs();  // of numbers, or of bytes that are numbers

// The names of all codecs, in order: "blosc, bytes, bz2, ...".
std::string CodecNames();

// The most that a compressor makes of `size_bytes` bytes, or a shard takes with unused ones.
std::int64_t MaxCompressedBytes(std::int64_t size_bytes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CODEC_H_
