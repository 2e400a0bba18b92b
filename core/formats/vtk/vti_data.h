// The bytes of one array of a VTK ImageData file, decoded: base64 and blocks of zlib, LZ4 and LZMA undone.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTI_DATA_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTI_DATA_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/formats/vtk/vti_header.h"
#include "core/io/file.h"

namespace isoscope::source {

// Thread-compatible.
class VtiData {
 public:
  virtual ~VtiData() = default;

  // Bytes [offset, offset + size) of the array, in the byte order of the file. DATA_LOSS: damaged.
  virtual absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) = 0;
  // Memory while it is read: for compressed data one block as it is and decoded, 8 bytes a block,
  // and for LZMA 72 MiB.
  [[nodiscard]] virtual std::int64_t memory_bytes() const = 0;

  // Returns a reader of the same bytes, for another thread.
  [[nodiscard]] virtual std::unique_ptr<VtiData> Again() const = 0;
  // The bytes of the blocks that are decoded as one; 0: they are read at any place. Not set: a reader
  // takes so much memory, for LZMA, that there should be one only.
  [[nodiscard]] virtual std::optional<std::int64_t> block_bytes() const = 0;
  // Where byte 0 is in the file, of data that lie there as they are; not set: of others.
  [[nodiscard]] virtual std::optional<std::int64_t> plain_start() const { return std::nullopt; }
};

// Opens the array, which must have `size` bytes. `file` must outlive the result.
// INVALID_ARGUMENT: data as text ("ascii"); another compressor or encoding; another size than the
// array says; the file ends before.
absl::StatusOr<std::unique_ptr<VtiData>> OpenVtiData(const io::RandomAccessFile& file,
                                                     const VtiHeader& header, const VtiArray& array,
                                                     std::int64_t size);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTI_DATA_H_
