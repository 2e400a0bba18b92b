// The flags for reading a source volume.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "core/formats/open_request.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/source/adapt/adjusted_source.h"
#include "core/volume/label.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {

// Other names are for a command that has another flag of that name.
struct SourceFlagNames {
  std::string format = "--format";
  std::string axes = "--axes";
};
inline const SourceFlagNames kRenderFlagNames{.axes = "--input-axes"};  // --axes draws axes

// Raw files need dims and type; other files must not have any of the flags of raw files.
struct SourceFlags {
  std::optional<math::Index3> dims;
  std::optional<volume::ScalarType> type;
  std::optional<bool> is_big_endian;
  std::optional<std::int64_t> header_bytes;
  // For any file:
  std::optional<std::string> format;
  std::optional<std::string> dicom_series;  // number or UID
  std::optional<std::string> axes;
  std::optional<math::Vec3d> spacing;
  std::optional<math::Vec3d> origin;
  std::optional<math::Mat3d> direction;
  std::optional<source::SampleBox> crop;
  std::optional<std::int64_t> stride;
  std::optional<double> fill;
  std::optional<std::string> label_names;  // a file
  bool ignores_shear = false;
  bool resamples = false;

  SourceFlagNames names = {};  // of the command

  // The first flag given, "--dims" for instance, or null; of all, and of those of raw files.
  [[nodiscard]] const char* FirstGiven() const;
  [[nodiscard]] const char* FirstOfRaw() const;
};

// `flags` must outlive the parsing.
void AddSourceFlags(FlagSet* set, SourceFlags* flags, const SourceFlagNames& names = {});

// Parses a path, or an address, which becomes its path (source::PathOfSource).
absl::StatusOr<std::string> ParseSource(absl::string_view text);

// UsageError if the flags do not fit each other, the file's name, or a folder.
absl::Status CheckUsage(const SourceFlags& flags, const std::string& path);

// UsageError if any flag is given: the samples and names of a dataset in a folder stay as they are.
absl::Status CheckUsageWithDataset(const SourceFlags& flags, const std::string& directory);

// All that the flags say of the source at `path`. REQUIRES: CheckUsage is OK.
source::OpenRequest RequestOf(const SourceFlags& flags, const std::string& path);

// The flags as one types them behind the path, each with a space before it: for commands that are
// suggested.
std::string AsTyped(const SourceFlags& flags, const SourceFlagNames& names = {});

// Returns the files of the source. Errors as source::FilesOf; NOT_FOUND if it is a folder that
// holds no volume.
absl::StatusOr<std::vector<std::string>> SourceFiles(const source::OpenRequest& request);

// Returns the names and colours of labels: those of label_names, else those that the file has,
// else those of a file beside it (LabelNamesBeside), which is said on `err`. Labels of these two
// that are damaged are reported there and passed over. `err` may be null.
// Errors as source::ReadLabelNames.
absl::StatusOr<std::vector<volume::Label>> LabelsOfSource(const source::OpenRequest& request,
                                                          std::ostream* err);

// One line a format that --format knows, and those that only names tell.
std::string ListFormats();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SOURCE_FLAGS_H_
