// The folder in which a series is written, or what is appended to one, volume by volume. Internal
// to the series partitioner.
//
//   flow.partial/ or flow/append.partial/
//   ├── lock                      held by the process that writes
//   ├── volume/                   the scalar volume under way: a dataset of version 1
//   ├── finished/field-000-component-0-step-00000
//   │                             a file for each finished volume: what it was made from, and the
//   │                             checksum of its manifest
//   ├── shard-00000-of-00002/field-000-component-0-step-00000/
//   └── manifest.json             appending: all is finished, and what is left is to move it

#ifndef ISOSCOPE_CORE_PARTITION_SERIES_WORK_FOLDER_H_
#define ISOSCOPE_CORE_PARTITION_SERIES_WORK_FOLDER_H_

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/io/file_lock.h"
#include "core/store/series_manifest.h"

namespace isoscope::partition {

// Of a series: who holds it appends, or changes the manifests otherwise.
inline constexpr absl::string_view kAppendFolderName = "append.partial";

// Thread-compatible.
class SeriesWorkFolder {
 public:
  // Makes `path`, or takes what a process left that was interrupted, and locks it.
  // FAILED_PRECONDITION: another process writes there.
  static absl::StatusOr<std::unique_ptr<SeriesWorkFolder>> Take(const std::string& path);
  // Removes it with everything in it, unless it holds what another run may go on with, or was moved
  // away.
  ~SeriesWorkFolder();
  SeriesWorkFolder(const SeriesWorkFolder&) = delete;
  SeriesWorkFolder& operator=(const SeriesWorkFolder&) = delete;

  // Removes everything in it. A process that is killed meanwhile leaves nothing to go on with, or
  // the manifest and all that it needs.
  absl::Status Clear();
  // Makes the folders of shards that are not there yet, and removes all but finished volumes.
  absl::Status Prepare(int shard_count);
  // Removes the volumes with other keys, which another run has left.
  [[nodiscard]] absl::Status RemoveOtherVolumes(
      const std::vector<store::ScalarVolumeKey>& keys) const;

  // Where the partitioner writes the next volume.
  [[nodiscard]] std::string volume_path() const { return path_ + "/volume"; }
  // Whether the volume was finished, from the same source with the same parameters, and is whole:
  // reads all of it. One that is damaged is logged. CANCELLED.
  [[nodiscard]] absl::StatusOr<bool> IsFinished(const store::ScalarVolumeKey& key,
                                                absl::string_view fingerprint,
                                                const base::Cancellation& cancellation) const;
  // Takes the volume under way as finished.
  absl::Status Finish(const store::ScalarVolumeKey& key, absl::string_view fingerprint);
  // Returns a finished volume as a series manifest describes it. DATA_LOSS if its manifest is
  // damaged.
  [[nodiscard]] absl::StatusOr<store::ScalarVolume> Describe(
      const store::ScalarVolumeKey& key) const;

  // Gives it the name `to`, and removes what only the writer needs.
  absl::Status MoveTo(const std::string& to);

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::string ShardPath(int shard) const;

 private:
  explicit SeriesWorkFolder(std::string path) : path_(std::move(path)) {}
  // Whether there are finished volumes, or a manifest that the series still needs.
  [[nodiscard]] bool HoldsFinished() const;
  [[nodiscard]] std::set<std::string> EntriesToKeep() const;
  [[nodiscard]] std::string RecordPath(const store::ScalarVolumeKey& key) const;
  [[nodiscard]] std::string VolumePath(const store::ScalarVolumeKey& key, int shard) const;
  [[nodiscard]] absl::StatusOr<std::string> ReadManifest(const store::ScalarVolumeKey& key,
                                                         int shard) const;
  // OK if all files of the volume are what its manifest says. DATA_LOSS. CANCELLED.
  [[nodiscard]] absl::Status Verify(const store::ScalarVolumeKey& key,
                                    const base::Cancellation& cancellation) const;

  const std::string path_;
  std::unique_ptr<io::FileLock> lock_;
  int shard_count_ = 0;
  bool is_moved_ = false;
};

// Removes the entries of a folder whose names are told.
absl::Status RemoveEntries(const std::string& path,
                           const std::function<bool(const std::string& name)>& is_told);

// Removes files of a series as "manifest.json.partial-4711", which processes left that were killed.
// REQUIRES: the caller has taken the folder in which the series is appended to.
absl::Status RemovePartialManifests(const std::string& directory, int shard_count);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SERIES_WORK_FOLDER_H_
