// One shard of a series: it opens scalar volumes when they are asked for, and notices new ones.
//
// 1. Open reads the manifest and finds the volumes whose folders are there. Nothing else is open.
// 2. OpenVolume opens the shard of one volume and keeps it, as long as all that are kept fit into
//    the memory that they share (OpenVolumes). A frame holds those that it draws.
// 3. Refresh reads the manifest again if the file was replaced. A folder that is not there yet (a
//    copy under way) is looked for at the next Refresh. A manifest of another dataset, or one that
//    is damaged or can't be read, changes nothing: what was served is served on, and the next
//    Refresh tries again.
//
// A volume has the same number (Shard::number) whenever it is opened, so that caches stay valid.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SERIES_SHARD_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SERIES_SHARD_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"
#include "core/io/file_stamp.h"
#include "core/store/series_manifest.h"
#include "core/volume/volume_level.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// The open volumes of all series of an agent, least recently used last. Thread-safe.
class OpenVolumes {
 public:
  explicit OpenVolumes(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  // Null if it is not open.
  std::shared_ptr<const Shard> Find(std::uint32_t number) ABSL_LOCKS_EXCLUDED(mutex_);
  // Closes others, unless frames hold them, until `shard` fits. The newest is always kept. Returns
  // it, or the one with its number that is open already.
  std::shared_ptr<const Shard> Add(std::shared_ptr<const Shard> shard) ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns true if as many shards of this size fit beside these.
  [[nodiscard]] bool HasRoomForAnother(
      const std::vector<std::shared_ptr<const Shard>>& shards) const;

 private:
  struct Entry {
    std::shared_ptr<const Shard> shard;
    std::size_t bytes = 0;
  };

  const std::size_t max_bytes_;
  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);
  std::size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

// Thread-safe.
class SeriesShard {
 public:
  // A snapshot of the served volumes; never changes.
  struct Served {
    store::SeriesManifest manifest;
    std::uint32_t manifest_crc32c = 0;
    std::vector<store::ScalarVolume> volumes;  // whose folders are there, ascending by key
    std::vector<std::vector<int>> levels;      // of each volume: those whose folders are there
    bool lacks_folders = false;                // of volumes or levels that the manifest names
  };

  // The steps of one field's component that are served, and one of them.
  struct Place {
    store::ScalarVolumeKey key;
    std::vector<int> steps;    // numbers, ascending
    std::size_t position = 0;  // of key.step in `steps`
  };
  // Reads the manifest of a shard directory; tests inject faults.
  using ReadManifest = std::function<absl::StatusOr<store::SeriesShard>(const std::string&)>;

  // Opens a shard directory of a series. `open_volumes` is shared by all series of the agent.
  // Errors as store::OpenSeriesShard. open_samples: as for OpenShard
  static absl::StatusOr<std::unique_ptr<SeriesShard>> Open(
      const std::string& directory, std::shared_ptr<OpenVolumes> open_volumes,
      ReadManifest read_manifest = store::OpenSeriesShard,
      store::OpenSamples open_samples = nullptr);

  // Has a function called whenever the folder of a volume could be opened. Call it before the shard
  // is used by other threads.
  void WhenOpened(std::function<void(const std::string& directory)> on_opened) {
    on_opened_ = std::move(on_opened);
  }

  [[nodiscard]] const std::string& directory() const { return directory_; }
  [[nodiscard]] int shard_index() const { return shard_index_; }
  // The path of the source, as the manifest has it, if the samples of its volumes are there, as far as
  // the first one told when the series was opened; else "".
  [[nodiscard]] const std::string& source() const { return source_; }
  [[nodiscard]] bool is_index_only() const { return !source_.empty(); }
  [[nodiscard]] std::shared_ptr<const Served> served() const ABSL_LOCKS_EXCLUDED(mutex_);

  // Looks for new volumes. Cheap if there are none. Returns at once if another thread looks.
  void Refresh() ABSL_LOCKS_EXCLUDED(mutex_, refreshing_);

  // Whether the volume of this dataset id is served.
  [[nodiscard]] bool Has(const std::string& dataset_id) const;
  // Not set if it is not served. O(volumes).
  [[nodiscard]] std::optional<Place> PlaceOf(const std::string& dataset_id) const;
  // The dataset id of a volume; "" if it is not served.
  [[nodiscard]] std::string IdOf(const store::ScalarVolumeKey& key) const;
  // Opens it. Blocks on the disk. Errors as OpenShard; DATA_LOSS also if the folder holds another
  // volume. FAILED_PRECONDITION if it is not served.
  //
  // kForFrame: several threads open it once. kAhead: nobody waits for this thread, whose priority
  // is low; then a frame may open the volume, too, and one of both is kept.
  //
  // level: 0, or a level of the volume, which opens level 0, too. FAILED_PRECONDITION if it is not
  //        there
  enum class Opening { kForFrame, kAhead };
  absl::StatusOr<std::shared_ptr<const Shard>> OpenVolume(const std::string& dataset_id,
                                                          Opening opening = Opening::kForFrame,
                                                          int level = 0)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns volume::VolumeLevel::value_scale of a level of the volume; 1 if it is not served.
  [[nodiscard]] double ValueScaleOf(const std::string& dataset_id, int level) const;

 private:
  SeriesShard(std::string directory, std::shared_ptr<OpenVolumes> open_volumes,
              ReadManifest read_manifest, store::OpenSamples open_samples)
      : directory_(std::move(directory)),
        open_volumes_(std::move(open_volumes)),
        read_manifest_(std::move(read_manifest)),
        open_samples_(std::move(open_samples)) {}

  void RefreshAlone() ABSL_EXCLUSIVE_LOCKS_REQUIRED(refreshing_) ABSL_LOCKS_EXCLUDED(mutex_);
  // A level of a volume, and its number (Shard::number).
  struct VolumeToOpen {
    const store::ScalarVolume& volume;
    int level = 0;
    std::uint32_t number = 0;
    Opening opening = Opening::kForFrame;
  };
  absl::StatusOr<std::shared_ptr<const Shard>> OpenOnce(const VolumeToOpen& wanted)
      ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<std::shared_ptr<const Shard>> OpenNow(const VolumeToOpen& wanted);
  // Reads the files of level 0.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const Shard>> ReadVolume(
      const VolumeToOpen& wanted) const;
  [[nodiscard]] std::string DirectoryOf(const store::ScalarVolume& volume) const;
  // OpenSeriesShard, of the same shard of the same series.
  [[nodiscard]] absl::StatusOr<store::SeriesShard> ReadAgain(const Served& before) const;

  // The volumes of `shard` whose folders are there, after those of `before`.
  [[nodiscard]] std::shared_ptr<const Served> FindVolumes(store::SeriesShard shard) const;
  // Null if it is not served.
  [[nodiscard]] static const store::ScalarVolume* VolumeIn(const Served& served,
                                                           const std::string& dataset_id);

  const std::string directory_;
  const std::shared_ptr<OpenVolumes> open_volumes_;
  const ReadManifest read_manifest_;
  const store::OpenSamples open_samples_;                        // may be empty
  std::function<void(const std::string& directory)> on_opened_;  // may be empty
  int shard_index_ = 0;
  std::string source_;
  base::Mutex refreshing_;  // one at a time: an older list never replaces a newer one
  io::FileStamp stamp_ ABSL_GUARDED_BY(refreshing_);     // of the manifest that is served
  std::string last_error_ ABSL_GUARDED_BY(refreshing_);  // each is logged once
  mutable base::Mutex mutex_;
  std::shared_ptr<const Served> served_ ABSL_GUARDED_BY(mutex_);
  // Of volumes that were opened once, by dataset id, level and filter.
  std::map<std::tuple<std::string, int, volume::LevelFilter>, std::uint32_t> numbers_
      ABSL_GUARDED_BY(mutex_);
  std::set<std::uint32_t> opening_ ABSL_GUARDED_BY(mutex_);  // numbers of volumes
  base::CondVar opened_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SERIES_SHARD_H_
