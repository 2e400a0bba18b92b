// The files, offsets and encoding of a volume's samples. With them, samples are streamed in
// constant memory, compressed or not, and short files are detected.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_SAMPLE_LOCATION_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_SAMPLE_LOCATION_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/source/bytes/decoded_stream.h"
#include "core/source/bytes/zip_file.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct SampleLocation {
  // Together they hold the samples of volume_count volumes in order, each file the same number. A
  // sample is a tuple of components. A single file may be the header file.
  std::vector<std::string> files;
  // The members below hold for each file.
  std::int64_t offset = 0;       // bytes before the samples or the encoded stream
  bool has_more_behind = false;  // other bytes may follow: no warning of a longer file
  // The samples are the last bytes of the file, or of the encoded stream: the offset of raw ones
  // and decoded_skip are ignored.
  bool at_file_end = false;
  SampleEncoding encoding = SampleEncoding::kRaw;
  std::int64_t decoded_skip = 0;  // decoded bytes before the samples, if encoded
  ZipMember member{};             // of kZip; `offset` is ignored then

  bool is_big_endian = false;
  volume::ScalarType stored_type = volume::ScalarType::kUint8;
  // Samples are slope * stored + intercept, in double, unless slope is 1 and intercept 0. Then they
  // keep their type, unless other volumes of the file do not.
  double slope = 1;
  double intercept = 0;
  bool is_always_rescaled = false;

  std::int64_t volume_count = 1;
  std::int64_t components = 1;  // of a tuple
  // The ones that are read:
  std::int64_t volume = 0;
  std::int64_t component = 0;

  [[nodiscard]] bool is_encoded() const { return encoding != SampleEncoding::kRaw; }
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_SAMPLE_LOCATION_H_
