// The chunks of a PNG file (ISO/IEC 15948, section 5): pixels and metadata of a picture.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PNG_CHUNKS_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PNG_CHUNKS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::client {

inline constexpr absl::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);

struct PngChunk {
  absl::string_view type;  // four letters
  absl::string_view data;
  absl::string_view bytes;  // the whole chunk: length, type, data, CRC-32
};

// Returns the chunks in order, IHDR first and IEND last; views into `png`. Bytes after IEND are
// ignored. DATA_LOSS, with the offset, if the bytes are no PNG, end early, or a chunk's CRC is
// wrong.
absl::StatusOr<std::vector<PngChunk>> ParsePngChunks(absl::string_view png);

// Returns a whole chunk. REQUIRES: `type` has four letters; `data` has fewer than 2^31 bytes.
std::string MakePngChunk(absl::string_view type, absl::string_view data);

// Returns four bytes, most significant first, as all numbers of a PNG.
std::string BigEndian32(std::uint32_t value);
// REQUIRES: bytes.size() >= 4.
std::uint32_t LoadBigEndian32(absl::string_view bytes);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PNG_CHUNKS_H_
