// The flags for reading a source volume.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/cli/flag_set.h"
#include "core/math/vec.h"
#include "core/source/adjusted_source.h"
#include "core/source/grid_rules.h"
#include "core/source/volume_source.h"
#include "core/volume/label.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {

// Raw files need dims and type; other files must not have any of the flags of raw files.
struct SourceFlags {
  std::optional<math::Index3> dims;
  std::optional<volume::ScalarType> type;
  std::optional<math::Vec3d> spacing;
  std::optional<math::Vec3d> origin;
  std::optional<bool> is_big_endian;
  std::optional<std::int64_t> header_bytes;
  // For any file:
  std::optional<std::string> format;
  std::optional<std::string> dicom_series;  // number or UID
  std::optional<source::SampleBox> crop;
  std::optional<std::int64_t> stride;
  std::optional<double> fill;
  std::optional<std::string> label_names;  // a file
  bool ignores_shear = false;
  bool resamples = false;

  // The first flag given, "--dims" for instance, or null; of all, and of those of raw files.
  [[nodiscard]] const char* FirstGiven() const;
  [[nodiscard]] const char* FirstOfRaw() const;
  [[nodiscard]] source::Adjustment adjustment() const {
    return {
        .crop = crop, .stride = stride.value_or(1), .fill = fill, .ignores_shear = ignores_shear};
  }
  [[nodiscard]] source::GridRules rules() const {
    return {.ignores_shear = ignores_shear,
            .resamples = resamples,
            .fill = fill,
            .dicom_series = dicom_series.value_or("")};
  }
};

// `flags` must outlive the parsing.
// `format_flag` is --format, unless the command has another flag of that name.
void AddSourceFlags(FlagSet* set, SourceFlags* flags, const std::string& format_flag = "--format");

// Returns true if the suffix is that of a format with its own dimensions and type.
bool HasSelfDescribingName(const std::string& path);

// UsageError if the flags do not fit each other, the file's name, or a folder.
absl::Status CheckUsage(const SourceFlags& flags, const std::string& path);

// UsageError if any flag is given: the samples and names of a dataset in a folder stay as they are.
absl::Status CheckUsageWithDataset(const SourceFlags& flags, const std::string& directory);

// The path to open with the rules of the flags: `path`, or a file of the DICOM series that --series
// chooses beside files of other kinds. Errors as source::FindDicomSeriesFile.
absl::StatusOr<std::string> PathOfSource(const SourceFlags& flags, const std::string& path);

// Opens the volume as a raw file if --dims is given, else by its format, with the grids that
// --ignore-shear and --resample take; the part of it that --crop and --stride leave, with holes for
// --fill. Errors as source::OpenRawFile, source::OpenVolumeFile
// and source::AdjustSource.
absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenSource(const SourceFlags& flags,
                                                                 const std::string& path);

// Returns the files of the volume, and that of --label-names. Errors as source::FilesOfVolume;
// NOT_FOUND if it is a folder that holds no volume.
absl::StatusOr<std::vector<std::string>> SourceFiles(const SourceFlags& flags,
                                                     const std::string& path);

// Returns the names and colours of labels: those of --label-names, else those that the file has.
// Labels of the file that are damaged are reported on `err`, which may be null, and passed over.
// Errors as source::ReadLabelNames.
absl::StatusOr<std::vector<volume::Label>> LabelsOfSource(const SourceFlags& flags,
                                                          const std::string& path,
                                                          std::ostream* err);

// One line a format that --format knows, and those that only names tell.
std::string ListFormats();

// Returns all flags as canonical text: part of the key of a cached dataset.
std::string DescribeForKey(const SourceFlags& flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
