#include "client-cli/session/partition_volume.h"

#include <cstddef>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/cancellation.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/progress_line.h"
#include "core/store/shard_format.h"

namespace isoscope::cli {
namespace {

// Memory of the process apart from the partitioner's tables and samples: code, libraries, stacks.
// Measured before the first block: 37 MiB.
constexpr std::int64_t kProcessBytes = 40 * base::kMiB;

// Replaces progress and memory.
void ShowProgress(ProgressLine* line, partition::PartitionOptions* options) {
  options->reserved_bytes = kProcessBytes;
  options->progress = [line](const partition::PartitionProgress& progress) {
    if (progress.total_bytes > 0) {
      line->Update(progress.phase, progress.done_bytes, progress.total_bytes);
    }
  };
}

}  // namespace

absl::StatusOr<std::int64_t> ParseShardCount(absl::string_view text) {
  return client::ParseInteger(text, 1, store::kMaxShardCount);
}

absl::StatusOr<store::Manifest> PartitionVolume(const SourceFlags& flags, const std::string& input,
                                                partition::PartitionOptions options,
                                                const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            OpenSource(flags, input));
  PrintNote(*source, context);
  return PartitionVolume(*source, std::move(options), context);
}

void PrintNote(const source::VolumeSource& source, const Context& context) {
  if (const std::string note = source.note(); !note.empty()) {
    *context.err << "isoscope: " << base::Printable(absl::StrCat(source.name(), ": ", note))
                 << std::endl;
  }
}

absl::StatusOr<store::Manifest> PartitionVolume(source::VolumeSource& source,
                                                partition::PartitionOptions options,
                                                const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options);
  absl::StatusOr<store::Manifest> manifest =
      partition::Partition(source, options, context.interrupt->cancellation());
  if (!manifest.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted while partitioning; nothing was left behind");
  }
  return manifest;
}

absl::StatusOr<store::SeriesManifest> PartitionSeries(SeriesAction action,
                                                      source::VolumeSeries& source,
                                                      partition::SeriesPartitionOptions options,
                                                      const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options.volume);
  const base::Cancellation& cancellation = context.interrupt->cancellation();
  absl::StatusOr<store::SeriesManifest> series =
      action == SeriesAction::kMake ? partition::PartitionSeries(source, options, cancellation)
                                    : partition::AppendToSeries(source, options, cancellation);
  if (!series.ok() && cancellation.is_cancelled()) {
    const absl::string_view message = series.status().message();
    const std::size_t kept = message.find("; ");  // what the partitioner says of it
    return absl::CancelledError(absl::StrCat(
        "interrupted while partitioning",
        kept == absl::string_view::npos ? "; nothing was left behind" : message.substr(kept)));
  }
  return series;
}

}  // namespace isoscope::cli
