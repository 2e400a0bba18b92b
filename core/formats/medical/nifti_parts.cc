// The common parts of the headers of both versions of NIfTI, and of Analyze.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/formats/medical/nifti_layout.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/file_start.h"

namespace isoscope::source {
namespace {

struct NiftiType {
  std::int16_t code;
  volume::ScalarType type;
};
constexpr std::array<NiftiType, 8> kNiftiTypes{{{2, volume::ScalarType::kUint8},
                                                {4, volume::ScalarType::kInt16},
                                                {8, volume::ScalarType::kInt32},
                                                {16, volume::ScalarType::kFloat32},
                                                {64, volume::ScalarType::kFloat64},
                                                {256, volume::ScalarType::kInt8},
                                                {512, volume::ScalarType::kUint16},
                                                {768, volume::ScalarType::kUint32}}};

bool IsGzipName(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".gz"); }

// " (complex)"; "" for codes that NIfTI does not have.
const char* NameOfOtherType(std::int16_t code) {
  switch (code) {
    case 1:
      return " (single bits)";
    case 32:
    case 1792:
    case 2048:
      return " (complex)";
    case 128:
    case 2304:
      return " (RGB colours)";
    case 1536:
      return " (float128)";
    default:
      return "";
  }
}

}  // namespace

absl::StatusOr<volume::ScalarType> NiftiSampleType(std::int16_t code, const std::string& path) {
  const auto* row = std::find_if(kNiftiTypes.begin(), kNiftiTypes.end(),
                                 [&](const NiftiType& known) { return known.code == code; });
  if (row == kNiftiTypes.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NIfTI datatype %d%s; expected one number a sample, an integer of 8 to 64 bits, "
        "float32 or float64 (codes 2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280): convert the file "
        "to one of them",
        path, code, NameOfOtherType(code)));
  }
  return row->type;
}

absl::StatusOr<std::vector<std::string>> NiftiImageOfPair(const std::string& header_path) {
  const std::size_t slash = header_path.rfind('/');
  std::string name = header_path.substr(slash == std::string::npos ? 0 : slash + 1);
  if (IsGzipName(name)) {
    name.resize(name.size() - 3);
  }
  const std::string image = absl::StrCat(name.substr(0, name.rfind('.')), ".img");
  auto plain = SingleFile(header_path, image);
  auto packed = plain.ok() ? plain : SingleFile(header_path, image + ".gz");
  return packed.ok() ? packed : plain;
}

absl::Status SetNiftiScale(double slope, double intercept, const char* format,
                           const std::string& path, SampleLocation* location) {
  if (slope == 0 || std::isnan(slope)) {
    return absl::OkStatus();
  }
  if (!std::isfinite(slope) || !std::isfinite(intercept)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the %s header scales samples by %g and adds %g; expected finite numbers, or a slope "
        "of 0 for none: the file is damaged",
        path, format, slope, intercept));
  }
  location->slope = slope;
  location->intercept = intercept;
  return absl::OkStatus();
}

bool IsNiftiStream(const std::string& header_path, const std::string& file) {
  return (file == header_path || IsGzipName(file)) && IsGzipFile(file);
}

const char* NiftiTimeUnit(std::uint8_t units) {
  switch (units & 0x38) {
    case 8:
      return "s";
    case 16:
      return "ms";
    case 24:
      return "us";
    default:
      return "";
  }
}

}  // namespace isoscope::source
