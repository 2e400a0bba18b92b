// Formats whose header, which we read ourselves, says all about the volumes of a file. They are
// rows of format_table.h.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_LAYOUT_FORMATS_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_LAYOUT_FORMATS_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/bytes/file_layout.h"

namespace isoscope::source {

// Returns true if the beginning of a header file, decoded, is of this format.
bool IsNifti1Header(absl::string_view head);
bool IsNifti2Header(absl::string_view head);
bool IsAnalyzeHeader(absl::string_view head);
bool IsMghHeader(
    absl::string_view head);  // a version and sizes that may be: the format has no mark
bool IsAfniHeader(absl::string_view head);
bool IsParHeader(absl::string_view head);
bool IsBrukerHeader(absl::string_view head);
bool IsMrtrixHeader(absl::string_view head);

// The header beside a file of samples: "a.hdr" or "a.hdr.gz" for "a.img" and "a.img.gz", "a.HEAD"
// for "a.BRIK.gz", "a.PAR" for "a.REC", "visu_pars" for "2dseq"; else `path` itself.
std::string LayoutHeaderPath(const std::string& path);

// Returns true if a name is that of NIfTI or Analyze: .nii, .hdr or .img, each also .gz. Which of
// them it is, the content says.
bool HasNiftiName(const std::string& path);

// The readers of headers. A grid that is sheared is read as it is: MakeLayoutSeries refuses it.
// INVALID_ARGUMENT: damaged, or what the format has and we do not read,
// with its numbers. NOT_FOUND: the file of the samples is missing. DATA_LOSS: a stream that is
// damaged.
//
// NIfTI of both versions. The fourth axis is time, toffset + index * pixdim[4] in its unit; the
// fifth one components. The grid is that of the sform if it is straight, or if there is no qform,
// else that of the qform.
absl::StatusOr<FileLayout> ReadNiftiHeaderLayout(const std::string& path);
// Analyze 7.5: a pair .hdr and .img. The format has no agreed orientation, so the world is that of
// the spacing alone, without a patient frame. The fourth axis is time.
absl::StatusOr<FileLayout> ReadAnalyzeLayout(const std::string& path);
// MGH and MGZ of FreeSurfer: frames are steps, by the repetition time behind the samples of a .mgh.
absl::StatusOr<FileLayout> ReadMghLayout(const std::string& path);
// AFNI: .HEAD with .BRIK, .BRIK.gz or .BRIK.bz2. Sub-bricks are steps if the file has a time axis,
// else fields of their labels.
absl::StatusOr<FileLayout> ReadAfniLayout(const std::string& path);
// PAR/REC of Philips, versions 4 to 4.2. Samples are the values of the console, slope * stored +
// intercept. Types of images (magnitude, phase, ...) are fields; dynamics, echoes or another key
// that varies are steps.
absl::StatusOr<FileLayout> ReadParRecLayout(const std::string& path);
// Reconstructions of Bruker's ParaVision: visu_pars with 2dseq. Images of several kinds and coils
// are fields; echoes, cycles and other groups of frames are steps without a time.
absl::StatusOr<FileLayout> ReadBrukerLayout(const std::string& path);
// MRtrix: .mif, .mif.gz, and .mih with the files that it names. A fourth axis is steps without a
// time.
absl::StatusOr<FileLayout> ReadMrtrixLayout(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_LAYOUT_FORMATS_H_
