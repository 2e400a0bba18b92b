// `render --like` draws the record of a picture again, and compares the two pictures:
//
// 1. ReadRecordedPng splits the file into its record and the PNG without it.
// 2. CheckOnlyFlagsBesideLike refuses every flag that is not known to leave all pixels as they are.
// 3. CheckSameSamples compares the digests of the samples.
// 4. ComparePictures compares the bytes, then the pixels outside the boxes of annotations.
// 5. DescribeComparison judges:
//
//      same bytes                        one line that says so
//      same pixels                       one line: another encoder, or another revision
//      other pixels, another revision    one line with the count and the largest difference
//      other pixels, the same revision   FAILED_PRECONDITION: a changed file, or a bug

#include "clients/cpp/connection/like_picture.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"

namespace isoscope::client {
namespace {

constexpr std::int64_t kMaxPictureBytes = 2 * base::kGiB;

// Flags that do not affect a pixel. All other flags do: a new flag is refused with --like until it
// is added here.
constexpr auto kFlagsBesideLike = std::to_array<absl::string_view>(
    {"input",       "server",    "dataset",         "dims",       "type",     "spacing",
     "origin",      "endian",    "header-bytes",    "shards",     "threads",  "memory-limit",
     "cache-limit", "timeout",   "verbose",         "renderer",   "output",   "stats",
     "culling",     "like",      "no-metadata",     "help",       "trace",    "axes",
     "scale-bar",   "caption",   "legend",          "show",       "insecure", "tls-ca",
     "tls-cert",    "tls-key",   "tls-server-name", "token-file", "quiet",    "label-names",
     "no-measures", "direction", "input-axes",      "series",     "format",   "crop",
     "stride",      "fill",      "ignore-shear",    "resample"});

absl::Status WithPath(const std::string& path, const absl::Status& status) {
  return {status.code(), absl::StrCat("--like '", path, "': ", status.message())};
}

// Returns, row by row, true for the pixels of an annotated picture that lie in no box.
std::vector<bool> PlainPixels(const RecordedPng& recorded, int width, int height) {
  std::vector<bool> is_plain(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                             true);
  if (!recorded.record.annotated) {
    return is_plain;
  }
  for (const view::PixelRect& box : recorded.record.annotated->boxes) {
    for (int y = box.begin_y; y < std::min(box.end_y, height); ++y) {
      for (int x = box.begin_x; x < std::min(box.end_x, width); ++x) {
        is_plain[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)] = false;
      }
    }
  }
  return is_plain;
}

int LargestDifference(const image::Rgba8& a, const image::Rgba8& b) {
  return std::max(
      {std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b), std::abs(a.a - b.a)});
}

}  // namespace

absl::StatusOr<RecordedPng> ReadRecordedPng(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string png, io::ReadWholeFile(path, kMaxPictureBytes));
  absl::StatusOr<RecordedPng> recorded = SplitRecordedPng(png);
  return recorded.ok() ? std::move(recorded) : WithPath(path, recorded.status());
}

absl::Status CheckOnlyFlagsBesideLike(const cli::FlagSet& set) {
  for (const std::string& name : set.GivenNames()) {
    if (std::find(kFlagsBesideLike.begin(), kFlagsBesideLike.end(), name) ==
        kFlagsBesideLike.end()) {
      return cli::UsageError(
          absl::StrCat("--", name, " can't be used with --like, whose picture decides it"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckSameSamples(const PictureRecord& record, const isoscope::v1::Dataset& dataset) {
  if (!dataset.fields().empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "dataset '", dataset.name(),
        "' has fields, whose pictures have no digest of their samples, so they can't be "
        "compared: render the picture's flags without --like"));
  }
  if (dataset.samples_digest().empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("dataset '", dataset.name(),
                     "' has no digest of its samples, so they can't be compared with those of the "
                     "picture: partition the volume anew, with this version"));
  }
  if (record.samples_digest.empty()) {
    return absl::FailedPreconditionError(
        "the picture was made of a dataset without a digest of its samples, so they can't be "
        "compared");
  }
  if (record.samples_digest != dataset.samples_digest()) {
    return absl::FailedPreconditionError(
        absl::StrCat("the picture shows other samples, or the same on another grid: their digest "
                     "is ",
                     record.samples_digest, ", that of dataset '", dataset.name(), "' is ",
                     dataset.samples_digest()));
  }
  return absl::OkStatus();
}

std::string PictureRevisionOf(const isoscope::v1::GetClusterStatusResponse& cluster,
                              const isoscope::v1::Dataset& dataset) {
  for (const isoscope::v1::AgentStatus& agent : cluster.agents()) {
    if (agent.state() != isoscope::v1::AgentStatus::STATE_REACHABLE) {
      continue;
    }
    for (const isoscope::v1::ServedShard& shard : agent.shards()) {
      if (shard.dataset_id() == dataset.dataset_id()) {
        return agent.picture_revision();
      }
    }
  }
  return "";
}

absl::StatusOr<PictureComparison> ComparePictures(const RecordedPng& recorded,
                                                  absl::string_view plain_png) {
  ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage before, image::DecodePng(recorded.plain_png));
  ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage now, image::DecodePng(plain_png));
  if (before.width != now.width || before.height != now.height) {
    return absl::DataLossError(absl::StrCat("the picture has ", before.width, " x ", before.height,
                                            " pixels, but its record makes ", now.width, " x ",
                                            now.height, ": it was scaled or cut"));
  }
  PictureComparison comparison;
  const auto& annotated = recorded.record.annotated;
  comparison.has_same_bytes = annotated ? annotated->plain_png_sha256 == base::Sha256Hex(plain_png)
                                        : recorded.plain_png == plain_png;
  const std::vector<bool> is_plain = PlainPixels(recorded, now.width, now.height);
  for (std::size_t i = 0; i < is_plain.size(); ++i) {
    if (!is_plain[i]) {
      continue;
    }
    ++comparison.compared_count;
    const int difference = LargestDifference(before.pixels[i], now.pixels[i]);
    comparison.different_count += difference > 0 ? 1 : 0;
    comparison.largest_difference = std::max(comparison.largest_difference, difference);
  }
  return comparison;
}

absl::StatusOr<std::string> DescribeComparison(const PictureComparison& comparison,
                                               const std::string& like_path,
                                               const std::string& like_revision,
                                               const std::string& revision) {
  if (comparison.has_same_bytes && comparison.different_count == 0) {
    return absl::StrCat("byte for byte the picture of '", like_path, "'");
  }
  const bool is_same_revision = like_revision == revision;
  if (comparison.different_count == 0 && !is_same_revision) {
    return absl::StrCat("all ", cli::FormatCount(comparison.compared_count),
                        " pixels are those of '", like_path, "', of picture revision '",
                        like_revision, "'; this is '", revision, "'");
  }
  if (comparison.different_count == 0) {
    return absl::StrCat("all ", cli::FormatCount(comparison.compared_count),
                        " pixels are those of '", like_path,
                        "', which another program or a change outside them has encoded "
                        "otherwise");
  }
  const std::string text =
      absl::StrCat(cli::FormatCount(comparison.different_count), " of ",
                   cli::FormatCount(comparison.compared_count), " pixels differ from '", like_path,
                   "', by at most ", comparison.largest_difference, " of 255");
  if (is_same_revision) {
    return absl::FailedPreconditionError(
        absl::StrCat(text, ", though both have the picture revision '", revision,
                     "': the file was changed after it was made, or this is a bug"));
  }
  return absl::StrCat(text, "; it has the picture revision '", like_revision, "', this is '",
                      revision, "'");
}

}  // namespace isoscope::client
