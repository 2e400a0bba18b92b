#include "partition-agent/shard_set.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/base/error_reason.h"
#include "core/base/printable.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/volume/volume_level.h"
#include "wire/proto_convert.h"

namespace isoscope::agent {

void ShardSet::Fill(Shards shards, SeriesShards series) {
  ISOSCOPE_CHECK(!is_filled());
  shards_ = std::move(shards);
  series_ = std::move(series);
  is_filled_.store(true, std::memory_order_release);
}

namespace {

absl::StatusOr<std::shared_ptr<const Shard>> OpenPlain(const std::shared_ptr<const Shard>& shard,
                                                       int level) {
  if (level == 0) {
    return shard;
  }
  const auto index = static_cast<std::size_t>(level - 1);
  if (index < shard->levels.size() && shard->levels[index] != nullptr) {
    return shard->levels[index];
  }
  const store::Manifest& manifest = shard->reader->manifest();
  return absl::FailedPreconditionError(
      absl::StrCat("shard ", shard->reader->shard_index(), " of dataset \"", manifest.name,
                   "\" is served without level ", level,
                   level <= manifest.highest_level()
                       ? ", whose files are missing or damaged: the agent's log says why"
                       : "; `isoscope partition --add-levels` makes levels"));
}

}  // namespace

int ShardSet::Served::index() const {
  return series != nullptr ? series->shard_index() : (*plain)->reader->shard_index();
}

absl::StatusOr<std::shared_ptr<const Shard>> ShardSet::Served::Open(
    const std::string& dataset_id, int level, SeriesShard::Opening opening) const {
  absl::StatusOr<std::shared_ptr<const Shard>> opened =
      series != nullptr ? series->OpenVolume(dataset_id, opening, level) : OpenPlain(*plain, level);
  if (level > 0 && absl::IsFailedPrecondition(opened.status())) {
    return base::WithReason(opened.status(), base::ErrorReason::kDatasetIncomplete);
  }
  return opened;
}

LevelShards ShardSet::Served::DescribeLevel(const std::string& dataset_id, int level) const {
  if (series != nullptr) {
    return {.shards = {},
            .whole = series->served()->manifest.geometry,
            .value_scale = series->ValueScaleOf(dataset_id, level)};
  }
  const store::Manifest& manifest = (*plain)->reader->manifest();
  const double scale =
      level == 0 ? 1 : volume::LevelValueScale(manifest.scalar_type, manifest.level_filter);
  return {.shards = {}, .whole = manifest.geometry, .value_scale = scale};
}

absl::StatusOr<std::vector<ShardSet::Served>> ShardSet::ServedOf(
    const std::string& dataset_id) const {
  if (!is_filled()) {
    return base::WithReason(
        base::WithRetryDelay(absl::UnavailableError("the agent is opening its shards; retry later"),
                             kOpeningDelay),
        base::ErrorReason::kAgentOpening);
  }
  std::vector<Served> found;
  for (const std::shared_ptr<const Shard>& shard : shards_) {
    if (shard->reader->manifest().dataset_id == dataset_id) {
      found.push_back({.plain = &shard});
    }
  }
  for (const std::shared_ptr<SeriesShard>& shard : series_) {
    if (shard->Has(dataset_id)) {
      found.push_back({.series = shard.get()});
    }
  }
  if (found.empty()) {
    return base::WithReason(
        absl::FailedPreconditionError(absl::StrCat("dataset id ", base::Quoted(dataset_id),
                                                   " is not served by this agent (any more)")),
        base::ErrorReason::kDatasetIncomplete);
  }
  return found;
}

absl::StatusOr<LevelShards> ShardSet::FindAny(const std::string& dataset_id, int level) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<Served> served, ServedOf(dataset_id));
  LevelShards found = served.front().DescribeLevel(dataset_id, level);
  ISOSCOPE_ASSIGN_OR_RETURN(
      found.shards.emplace_back(),
      served.front().Open(dataset_id, level, SeriesShard::Opening::kForFrame));
  return found;
}

absl::StatusOr<Shards> ShardSet::Find(
    const std::string& dataset_id,
    const google::protobuf::RepeatedField<std::int32_t>& shard_indices,
    SeriesShard::Opening opening) const {
  ISOSCOPE_ASSIGN_OR_RETURN(LevelShards found,
                            FindLevel(dataset_id, shard_indices, /*level=*/0, opening));
  return std::move(found.shards);
}

absl::StatusOr<LevelShards> ShardSet::FindLevel(
    const std::string& dataset_id,
    const google::protobuf::RepeatedField<std::int32_t>& shard_indices, int level,
    SeriesShard::Opening opening) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<Served> served, ServedOf(dataset_id));
  // All have the manifest of the dataset.
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Shard> first,
                            served.front().Open(dataset_id, /*level=*/0, opening));
  const store::Manifest& manifest = first->reader->manifest();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<int> wanted,
      wire::ShardIndicesFromProto(shard_indices, static_cast<int>(manifest.shards.size()),
                                  "shard_indices"));
  LevelShards found = served.front().DescribeLevel(dataset_id, level);
  for (const int index : wanted) {
    const auto position = std::find_if(served.begin(), served.end(),
                                       [&](const Served& of) { return of.index() == index; });
    if (position == served.end()) {
      std::vector<int> indices;
      std::transform(served.begin(), served.end(), std::back_inserter(indices),
                     [](const Served& of) { return of.index(); });
      std::sort(indices.begin(), indices.end());
      return base::WithReason(absl::FailedPreconditionError(
                                  absl::StrCat("shard ", index, " of dataset \"", manifest.name,
                                               "\" is not served by this agent (any more); it "
                                               "serves ",
                                               absl::StrJoin(indices, ", "))),
                              base::ErrorReason::kDatasetIncomplete);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Shard> shard,
                              position->Open(dataset_id, level, opening));
    found.shards.push_back(std::move(shard));
  }
  return found;
}

}  // namespace isoscope::agent
