// The shards that an agent serves, of any datasets.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "google/protobuf/repeated_field.h"

#include "partition-agent/series_shard.h"
#include "partition-agent/shard.h"

namespace isoscope::agent {

using SeriesShards = std::vector<std::shared_ptr<SeriesShard>>;

// Thread-safe. Dataset ids are those of datasets, or of scalar volumes of a series.
class ShardSet {
 public:
  explicit ShardSet(Shards shards, SeriesShards series = {})
      : shards_(std::move(shards)), series_(std::move(series)) {}

  // Finds the shards of a dataset by index, and opens those of a series. FAILED_PRECONDITION names
  // the dataset or shard that is not served; INVALID_ARGUMENT if the indices are malformed; of a
  // series also errors as SeriesShard::OpenVolume. O(shards). May block on the disk.
  [[nodiscard]] absl::StatusOr<Shards> Find(
      const std::string& dataset_id,
      const google::protobuf::RepeatedField<std::int32_t>& shard_indices,
      SeriesShard::Opening opening = SeriesShard::Opening::kForFrame) const;
  // Returns some shard of a dataset that is served, for what all shards have. Errors as Find.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const Shard>> FindAny(
      const std::string& dataset_id) const;

  // Those of datasets without fields.
  [[nodiscard]] const Shards& plain() const { return shards_; }
  [[nodiscard]] const SeriesShards& series() const { return series_; }
  [[nodiscard]] std::size_t size() const { return shards_.size() + series_.size(); }

 private:
  // One shard of a dataset that is served; of a series it is open or can be opened.
  struct Served {
    const std::shared_ptr<const Shard>* plain = nullptr;
    SeriesShard* series = nullptr;
    [[nodiscard]] int index() const;
    [[nodiscard]] absl::StatusOr<std::shared_ptr<const Shard>> Open(
        const std::string& dataset_id, SeriesShard::Opening opening) const;
  };
  // FAILED_PRECONDITION if there are none.
  [[nodiscard]] absl::StatusOr<std::vector<Served>> ServedOf(const std::string& dataset_id) const;

  const Shards shards_;
  const SeriesShards series_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
