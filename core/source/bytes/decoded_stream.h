// Samples that a file holds encoded, as a stream that is read front to back in constant memory.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_DECODED_STREAM_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_DECODED_STREAM_H_

#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

enum class SampleEncoding {
  kRaw,      // bytes as they are
  kDeflate,  // a gzip or zlib stream, or several gzip streams
  kBzip2,    // a bzip2 stream, or several
  kText,     // decimal numbers, apart by white space or commas
  kHex,      // bytes as two hexadecimal digits each, with white space anywhere
  kZip,      // a member of a ZIP archive (zip_file.h)
};

// Thread-compatible.
class DecodedStream {
 public:
  virtual ~DecodedStream() = default;

  // Decodes the next `size` bytes into `out` and returns how many there were: fewer only at the end
  // of the stream, or where the file is cut. DATA_LOSS: damaged, as far as the format can tell.
  virtual absl::StatusOr<std::size_t> Read(std::size_t size, char* out) = 0;
  // Reads on to the checksum that ends the stream, if it has one. INVALID_ARGUMENT if the file ends
  // before; DATA_LOSS if the checksum is wrong.
  virtual absl::Status VerifyEnd() = 0;
  // Starts over.
  virtual void Rewind() = 0;
  // Decoded bytes so far.
  [[nodiscard]] virtual std::int64_t position() const = 0;

  // Decodes and drops. Returns how many bytes there were.
  absl::StatusOr<std::int64_t> Skip(std::int64_t size);
};

// The stream of that encoding, neither kRaw nor kZip, which starts at `offset` of `file`. Text becomes samples
// of `type`, little-endian, and is read in whole samples. DATA_LOSS of Read also: a number that the
// type does not have, or a text that is none. `file` must outlive the stream.
std::unique_ptr<DecodedStream> MakeDecodedStream(SampleEncoding encoding, volume::ScalarType type,
                                                 const io::RandomAccessFile* file,
                                                 std::int64_t offset);

// The most that such a stream holds, with the scratch space of Skip; 0 for kRaw.
std::int64_t DecodedStreamBytes(SampleEncoding encoding);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_DECODED_STREAM_H_
