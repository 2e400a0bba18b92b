// Formats whose header, which we read ourselves, says all about the volumes of a file.

#ifndef ISOSCOPE_CORE_SOURCE_LAYOUT_FORMATS_H_
#define ISOSCOPE_CORE_SOURCE_LAYOUT_FORMATS_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/decoded_stream.h"
#include "core/source/file_layout.h"

namespace isoscope::source {

// The beginning of a file.
struct FileHead {
  std::string bytes;  // decoded; fewer than asked for at the end of the file
  SampleEncoding encoding = SampleEncoding::kRaw;  // kDeflate and kBzip2 by their first bytes
};
absl::StatusOr<FileHead> ReadFileHead(const std::string& path, std::size_t size);

struct LayoutFormat {
  const char* name;     // "MGH"
  const char* endings;  // for people: ".mgh .mgz"
  // Whether the header file is of this format, by its name and its decoded beginning.
  bool (*matches)(absl::string_view header_path, absl::string_view head);
  // Reads the header. INVALID_ARGUMENT: damaged, or what the format has and we do not read, with
  // its numbers. NOT_FOUND: the file of the samples. DATA_LOSS: a stream that is damaged.
  absl::StatusOr<FileLayout> (*read)(const std::string& header_path);
};

// All of them.
const std::vector<LayoutFormat>& LayoutFormats();
// The format of a path, which may be that of the samples; null if it has none of these. Reads the
// beginning of the header.
const LayoutFormat* FindLayoutFormat(const std::string& path);
// The header beside a file of samples: "a.hdr" for "a.img" and "a.img.gz", "a.HEAD" for
// "a.BRIK.gz", "a.PAR" for "a.REC"; else `path` itself.
std::string LayoutHeaderPath(const std::string& path);

// NIfTI-2: a header of 540 bytes. The layout is as that of NIfTI-1 (sample_series.h); the grid is
// that of the sform if it is straight, else that of the qform. INVALID_ARGUMENT also: a sheared
// sform without a qform.
absl::StatusOr<FileLayout> ReadNifti2Layout(const std::string& path);
// Analyze 7.5: a pair .hdr and .img. The format has no agreed orientation, so the world is that of
// the spacing alone, without a patient frame. The fourth axis is time.
absl::StatusOr<FileLayout> ReadAnalyzeLayout(const std::string& path);
// MGH and MGZ of FreeSurfer: frames are steps.
absl::StatusOr<FileLayout> ReadMghLayout(const std::string& path);
// AFNI: .HEAD with .BRIK, .BRIK.gz or .BRIK.bz2. Sub-bricks are steps if the file has a time axis,
// else fields of their labels.
absl::StatusOr<FileLayout> ReadAfniLayout(const std::string& path);
// PAR/REC of Philips, versions 4 to 4.2. Samples are the values of the console, slope * stored +
// intercept. Types of images (magnitude, phase, ...) are fields; dynamics, echoes or another key
// that varies are steps.
absl::StatusOr<FileLayout> ReadParRecLayout(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_LAYOUT_FORMATS_H_
