#include "client-cli/session/partition_volume.h"

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/cancellation.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/progress_line.h"
#include "core/indexed/sample_opener.h"
#include "core/source/series_parts.h"
#include "core/store/shard_format.h"

namespace isoscope::cli {
namespace {

// Memory of the process apart from the partitioner's tables and samples: code, libraries, stacks.
// Measured before the first block: 37 MiB.
constexpr std::int64_t kProcessBytes = 40 * base::kMiB;

// Of the memory limit, for the source of an index-only dataset.
constexpr std::int64_t kSourceShare = 4;

// Replaces progress and memory.
template <typename Options>
void ShowProgress(ProgressLine* line, Options* options) {
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

void WarnIfIncomplete(const std::string& directory, const Context& context) {
  const absl::StatusOr<store::SeriesDescription> series = store::IsSeriesDirectory(directory)
                                                              ? store::OpenSeries(directory)
                                                              : absl::NotFoundError("no series");
  const std::vector<store::MissingVolume> missing =
      series.ok() ? store::MissingVolumes(*series) : std::vector<store::MissingVolume>();
  if (missing.empty()) {
    return;  // whoever opens it reports errors
  }
  *context.err << "isoscope: "
               << base::Printable(absl::StrCat(
                      "'", directory, "' lacks volumes that its manifest names: ",
                      store::DescribeMissing(missing, series->manifest),
                      "; they can't be drawn, and the last step is the last that is whole: copy "
                      "them again, or partition anew"))
               << std::endl;
}

void PrintNote(const source::VolumeSource& source, const Context& context) {
  if (const std::string& note = source.info().note; !note.empty()) {
    *context.err << "isoscope: " << base::Printable(absl::StrCat(source.info().name, ": ", note))
                 << std::endl;
  }
}

absl::StatusOr<store::Manifest> PartitionVolume(source::VolumeSeries& source,
                                                partition::PartitionOptions options,
                                                const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> volume,
                            source.Open(0, 0, 0));
  PrintNote(*volume, context);
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options);
  options.check_source = [&source] { return source.IdentityOfStep(0).status(); };
  absl::StatusOr<store::Manifest> manifest =
      partition::Partition(*volume, options, context.interrupt->cancellation());
  if (!manifest.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted while partitioning; nothing was left behind");
  }
  return manifest;
}

absl::StatusOr<store::Manifest> PartitionVolume(const source::OpenRequest& request,
                                                partition::PartitionOptions options,
                                                const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> source,
                            source::OpenIdentified(request));
  const std::vector<source::SourceField>& fields = source->info().fields;
  if (fields.size() > 1 || fields[0].components.size() > 1 || source->info().step_count() > 1) {
    return absl::InvalidArgumentError(absl::StrCat(
        request.path, ": holds ", source::DescribeFields(fields), " at ",
        source->info().step_count(), " steps: name one volume of it, or partition it first"));
  }
  return PartitionVolume(*source, std::move(options), context);
}

absl::StatusOr<store::SeriesManifest> PartitionSeries(SeriesAction action,
                                                      source::VolumeSeries& source,
                                                      partition::SeriesPartitionOptions options,
                                                      const Context& context) {
  {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> first,
                              source.Open(0, 0, 0));
    PrintNote(*first, context);
  }
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

absl::StatusOr<partition::PartReport> PartitionPart(source::VolumeSeries& source,
                                                    partition::PartOptions options,
                                                    const Context& context) {
  {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> first,
                              source.Open(0, 0, 0));
    PrintNote(*first, context);
  }
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options.volume);
  const base::Cancellation& cancellation = context.interrupt->cancellation();
  absl::StatusOr<partition::PartReport> report =
      partition::PartitionPart(source, options, cancellation);
  if (!report.ok() && cancellation.is_cancelled()) {
    return absl::CancelledError(absl::StrCat(
        "interrupted while cutting part ", options.part.index, " of ", options.part.count,
        "; other parts, and volumes of this one that were finished, are kept: the same command "
        "cuts the rest"));
  }
  return report;
}

absl::StatusOr<partition::JoinedDataset> JoinParts(const std::string& output,
                                                   partition::JoinOptions options,
                                                   const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options);
  const base::Cancellation& cancellation = context.interrupt->cancellation();
  absl::StatusOr<partition::JoinedDataset> joined =
      partition::JoinParts(output, options, cancellation);
  if (!joined.ok() && cancellation.is_cancelled()) {
    return absl::CancelledError(
        "interrupted while joining; the parts are as they were: the same command begins again");
  }
  return joined;
}

absl::StatusOr<int> AddLevels(const std::string& directory, partition::AddLevelsOptions options,
                              const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  ShowProgress(&line, &options);
  options.source_bytes = options.memory_limit_bytes / kSourceShare;
  ISOSCOPE_ASSIGN_OR_RETURN(indexed::SourceAccess access, indexed::AccessOfUser());
  access.max_bytes = static_cast<std::size_t>(options.source_bytes);
  options.open_samples = indexed::MakeSampleOpener(access);
  const base::Cancellation& cancellation = context.interrupt->cancellation();
  absl::StatusOr<int> highest = partition::AddLevels(directory, options, cancellation);
  if (!highest.ok() && cancellation.is_cancelled()) {
    return absl::CancelledError(absl::StrCat(
        "interrupted while making levels; ", directory,
        " can be drawn as before, and the same command goes on with the first volume that is not "
        "finished"));
  }
  return highest;
}

}  // namespace isoscope::cli
