// Reads a gzip or zlib stream inside a file front to back, in constant memory.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_INFLATE_READER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_INFLATE_READER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/source/bytes/decoded_stream.h"

namespace isoscope::source {

// Thread-compatible. Holds about 300 KiB.
class InflateReader final : public DecodedStream {
 public:
  // The stream starts at `offset` of `file`, which must outlive the reader.
  InflateReader(const io::RandomAccessFile* file, std::int64_t offset);
  ~InflateReader() override;
  InflateReader(const InflateReader&) = delete;
  InflateReader& operator=(const InflateReader&) = delete;

  // Concatenated gzip members are one stream.
  absl::StatusOr<std::size_t> Read(std::size_t size, char* out) override;
  // Reads on to the end of the current member. Gives up silently, with OK, after 1 MiB of decoded
  // bytes.
  absl::Status VerifyEnd() override;
  void Rewind() override;
  [[nodiscard]] std::int64_t position() const override { return position_; }

 private:
  class Stream;

  const io::RandomAccessFile* file_;
  std::int64_t start_;
  std::int64_t next_input_ = 0;  // offset in the file of the next bytes to feed
  std::int64_t position_ = 0;
  std::string input_;
  std::unique_ptr<Stream> stream_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_INFLATE_READER_H_
