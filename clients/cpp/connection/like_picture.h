// Repeats a picture from the record in another one, and compares the two: `render --like`.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_LIKE_PICTURE_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_LIKE_PICTURE_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/connection/png_metadata.h"
#include "core/cli/flag_set.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::client {

// Reads the picture at `path` with its record. Errors name the path; as SplitRecordedPng and
// io::ReadWholeFile.
absl::StatusOr<RecordedPng> ReadRecordedPng(const std::string& path);

// UsageError if a flag of `set` contradicts the record. Allowed are the flags for the place of the
// samples, the output, and the execution.
absl::Status CheckOnlyFlagsBesideLike(const cli::FlagSet& set);

// FAILED_PRECONDITION unless samples and grid of `dataset` are those of the record.
absl::Status CheckSameSamples(const PictureRecord& record, const isoscope::v1::Dataset& dataset);

// Returns the picture revision of the agents that serve the dataset; "" if none is known.
std::string PictureRevisionOf(const isoscope::v1::GetClusterStatusResponse& cluster,
                              const isoscope::v1::Dataset& dataset);

struct PictureComparison {
  bool has_same_bytes = false;
  std::int64_t different_count = 0;
  std::int64_t compared_count = 0;  // pixels; without annotated ones
  int largest_difference = 0;       // of one channel, 0 to 255
};

// Compares `plain_png`, without a record, with the recorded picture. DATA_LOSS if one of them is no
// PNG, or their sizes differ.
absl::StatusOr<PictureComparison> ComparePictures(const RecordedPng& recorded,
                                                  absl::string_view plain_png);

// Returns one line for the user. FAILED_PRECONDITION, with that line, if pixels differ although
// both pictures have one revision: the file was changed, or the guarantee of exactness is violated.
absl::StatusOr<std::string> DescribeComparison(const PictureComparison& comparison,
                                               const std::string& like_path,
                                               const std::string& like_revision,
                                               const std::string& revision);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_LIKE_PICTURE_H_
