// Where in which files the samples of a volume lie, and how they are encoded: the part of a header
// that ITK reads but does not tell. With it samples are streamed in constant memory, compressed or
// not, and a file that is too short is noticed; ITK itself reads NIfTI and NRRD whole.

#ifndef ISOSCOPE_CORE_SOURCE_SAMPLE_LOCATION_H_
#define ISOSCOPE_CORE_SOURCE_SAMPLE_LOCATION_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/itk_header.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct SampleLocation {
  // One after the other they hold all samples, each as many: of volume_count volumes, one behind
  // the other, of tuples of components. One alone may be the header file.
  std::vector<std::string> files;
  // Of each file:
  std::int64_t offset = 0;        // bytes before the samples or the compressed stream
  bool at_file_end = false;       // the samples are the last bytes of the file; offset is ignored
  bool is_compressed = false;     // a gzip or zlib stream
  std::int64_t decoded_skip = 0;  // decoded bytes before the samples, if compressed

  bool is_big_endian = false;
  volume::ScalarType stored_type = volume::ScalarType::kUint8;  // NRRD, MetaImage: ITK tells
  // Samples are slope * stored + intercept, in double, unless slope is 1 and intercept 0.
  double slope = 1;
  double intercept = 0;

  std::int64_t volume_count = 1;
  std::int64_t components = 1;  // of a tuple
  // The ones that are read:
  std::int64_t volume = 0;
  std::int64_t component = 0;
};

// Reads the header of `path`. INVALID_ARGUMENT: not such a header; an encoding that is not
// supported; more or fewer data files than its sizes need. NOT_FOUND: a data file is missing.
absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path);

absl::StatusOr<SampleLocation> LocateNiftiSamples(const std::string& path);
absl::StatusOr<SampleLocation> LocateNrrdSamples(const std::string& path);
absl::StatusOr<SampleLocation> LocateMetaImageSamples(const std::string& path);

// The header file of a NIfTI pair: "a.hdr" for "a.img" and "a.img.gz"; else `path` itself.
std::string NiftiHeaderPath(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SAMPLE_LOCATION_H_
