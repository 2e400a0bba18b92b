// A picture made again from the record in another one, and compared with it: `render --like`.

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

// The picture at `path` with its record. Errors name the path; as SplitRecordedPng, and as
// io::ReadWholeFile.
absl::StatusOr<RecordedPng> ReadRecordedPng(const std::string& path);

// UsageError if a flag is given that the record decides: every flag of `set` but those that say
// where the samples are, where the result goes, and how the work is done.
absl::Status CheckOnlyFlagsBesideLike(const cli::FlagSet& set);

// FAILED_PRECONDITION unless the samples and the grid of `dataset` are those of the record.
absl::Status CheckSameSamples(const PictureRecord& record, const isoscope::v1::Dataset& dataset);

// The picture revision of the agents that serve the dataset; "" if none is known.
std::string PictureRevisionOf(const isoscope::v1::GetClusterStatusResponse& cluster,
                              const isoscope::v1::Dataset& dataset);

struct PictureComparison {
  bool has_same_bytes = false;
  std::int64_t different_count = 0;
  std::int64_t compared_count = 0;  // pixels; of an annotated picture those beside the annotations
  int largest_difference = 0;       // of one channel, 0 to 255
};

// Compares `plain_png`, without a record, with the recorded picture. DATA_LOSS if one of them is no
// PNG, or their sizes differ.
absl::StatusOr<PictureComparison> ComparePictures(const RecordedPng& recorded,
                                                  absl::string_view plain_png);

// One line for people. FAILED_PRECONDITION, with that line, if pixels differ though both pictures
// have one revision: somebody has changed the file, or the promise of exactness is broken.
absl::StatusOr<std::string> DescribeComparison(const PictureComparison& comparison,
                                               const std::string& like_path,
                                               const std::string& like_revision,
                                               const std::string& revision);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_LIKE_PICTURE_H_
