// A scalar volume is finished once its record is there: the folders that the partitioner wrote in
// `volume` were moved to their shards before. A process that is killed in between leaves a part of
// a volume without a record, which Finish replaces when the volume is made again.
//
// A volume that is kept is read first: its bytes, with the checksums of its manifest, and the
// manifest, with that of the record.

#include "core/partition/series_work_folder.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <system_error>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/dataset_verifier.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"

namespace isoscope::partition {
namespace {

constexpr absl::string_view kLockName = "lock";
constexpr absl::string_view kFinishedName = "finished";
constexpr std::int64_t kMaxRecordBytes = 4096;

absl::Status MakeFolder(const std::string& path) {
  return io::IsDirectory(path) ? absl::OkStatus() : io::CreateDirectory(path);
}

std::string RecordOf(absl::string_view fingerprint, const store::ScalarVolume& volume) {
  return absl::StrFormat("%s %08x", fingerprint, volume.manifest_crc32c);
}

absl::Status RemoveOthers(const std::string& path, const std::set<std::string>& kept) {
  return RemoveEntries(path, [&](const std::string& name) { return kept.count(name) == 0; });
}

}  // namespace

absl::Status RemoveEntries(const std::string& path,
                           const std::function<bool(const std::string& name)>& is_told) {
  std::error_code error;
  std::vector<std::string> others;
  for (std::filesystem::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    if (is_told(entry->path().filename().string())) {
      others.push_back(entry->path().string());
    }
  }
  if (error) {
    return io::ErrnoToStatus(error.value(), "list", path);
  }
  for (const std::string& other : others) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(other));
  }
  return absl::OkStatus();
}

absl::Status RemovePartialManifests(const std::string& directory, int shard_count) {
  const auto is_partial = [](const std::string& name) {
    return absl::StartsWith(name, absl::StrCat(store::kManifestFileName, ".partial-")) ||
           absl::StartsWith(name, absl::StrCat(store::kSeriesShardFileName, ".partial-"));
  };
  ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(directory, is_partial));
  for (int shard = 0; shard < shard_count; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, shard_count)), is_partial));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<SeriesWorkFolder>> SeriesWorkFolder::Take(const std::string& path) {
  std::unique_ptr<SeriesWorkFolder> folder(new SeriesWorkFolder(path));
  if (io::IsDirectory(absl::StrCat(path, "/parts"))) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": holds parts of this dataset (`isoscope info ", path,
                     "`): join them with `isoscope partition --finish ",
                     path.substr(0, path.rfind(".partial")), "`, or remove that folder"));
  }
  ISOSCOPE_RETURN_IF_ERROR(MakeFolder(path));
  absl::StatusOr<std::unique_ptr<io::FileLock>> lock =
      io::FileLock::Take(absl::StrCat(path, "/", kLockName));
  if (absl::IsFailedPrecondition(lock.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": another process writes there; wait until it has ended"));
  }
  ISOSCOPE_RETURN_IF_ERROR(lock.status());
  folder->lock_ = *std::move(lock);
  return folder;
}

SeriesWorkFolder::~SeriesWorkFolder() {
  const bool is_ours = lock_ != nullptr && !is_moved_;
  if (!is_ours || HoldsFinished()) {
    return;
  }
  if (const absl::Status removed = io::RemoveRecursively(path_); !removed.ok()) {
    base::LogWarning("partial_dataset_left", {{"path", base::OwnText{path_}}, {"status", removed}});
  }
}

bool SeriesWorkFolder::HoldsFinished() const {
  std::error_code error;
  const std::filesystem::path finished = absl::StrCat(path_, "/", kFinishedName);
  return io::PathExists(absl::StrCat(path_, "/", store::kManifestFileName)) ||
         (std::filesystem::is_directory(finished, error) &&
          !std::filesystem::is_empty(finished, error));
}

absl::Status SeriesWorkFolder::Clear() {
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(absl::StrCat(path_, "/", kFinishedName)));
  return RemoveOthers(path_, {std::string(kLockName)});
}

absl::Status SeriesWorkFolder::Prepare(int shard_count) {
  shard_count_ = shard_count;
  ISOSCOPE_RETURN_IF_ERROR(MakeFolder(absl::StrCat(path_, "/", kFinishedName)));
  for (int shard = 0; shard < shard_count; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(MakeFolder(ShardPath(shard)));
  }
  return RemoveOthers(path_, EntriesToKeep());
}

absl::Status SeriesWorkFolder::RemoveOtherVolumes(
    const std::vector<store::ScalarVolumeKey>& keys) const {
  std::set<std::string> names;
  for (const store::ScalarVolumeKey& key : keys) {
    names.insert(store::ScalarVolumeDirectoryName(key));
  }
  for (int shard = 0; shard < shard_count_; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(RemoveOthers(ShardPath(shard), names));
  }
  return RemoveOthers(path_, EntriesToKeep());
}

std::set<std::string> SeriesWorkFolder::EntriesToKeep() const {
  std::set<std::string> names = {std::string(kLockName), std::string(kFinishedName)};
  for (int shard = 0; shard < shard_count_; ++shard) {
    names.insert(store::ShardDirectoryName(shard, shard_count_));
  }
  return names;
}

std::string SeriesWorkFolder::ShardPath(int shard) const {
  return absl::StrCat(path_, "/", store::ShardDirectoryName(shard, shard_count_));
}

std::string SeriesWorkFolder::VolumePath(const store::ScalarVolumeKey& key, int shard) const {
  return absl::StrCat(ShardPath(shard), "/", store::ScalarVolumeDirectoryName(key));
}

absl::StatusOr<std::string> SeriesWorkFolder::ReadManifest(const store::ScalarVolumeKey& key,
                                                           int shard) const {
  return io::ReadWholeFile(absl::StrCat(VolumePath(key, shard), "/", store::kManifestFileName),
                           store::kMaxManifestBytes);
}

std::string SeriesWorkFolder::RecordPath(const store::ScalarVolumeKey& key) const {
  return absl::StrCat(path_, "/", kFinishedName, "/", store::ScalarVolumeDirectoryName(key));
}

absl::StatusOr<bool> SeriesWorkFolder::IsFinished(const store::ScalarVolumeKey& key,
                                                  absl::string_view fingerprint,
                                                  const base::Cancellation& cancellation) const {
  const absl::StatusOr<std::string> record = io::ReadWholeFile(RecordPath(key), kMaxRecordBytes);
  if (!record.ok() || !absl::StartsWith(*record, fingerprint)) {
    return false;
  }
  const absl::StatusOr<store::ScalarVolume> volume = Describe(key);
  absl::Status status = volume.status();
  if (status.ok()) {
    status = *record == RecordOf(fingerprint, *volume)
                 ? Verify(key, cancellation)
                 : absl::DataLossError("the manifest is not that of the finished volume");
  }
  if (absl::IsCancelled(status)) {
    return status;
  }
  if (!status.ok()) {
    base::LogWarning("finished_volume_damaged",
                     {{"volume", store::ScalarVolumeDirectoryName(key)}, {"status", status}});
  }
  return status.ok();
}

absl::Status SeriesWorkFolder::Verify(const store::ScalarVolumeKey& key,
                                      const base::Cancellation& cancellation) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string expected, ReadManifest(key, 0));
  std::string damage;
  VerifyOptions options;
  options.damage = [&damage](const std::string& message) { damage = message; };
  for (int shard = 0; shard < shard_count_; ++shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string manifest, ReadManifest(key, shard));
    if (manifest != expected) {
      return absl::DataLossError(
          absl::StrCat("shard ", shard, " has another manifest than shard 0"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const VerifyReport report,
                              VerifyDataset(VolumePath(key, shard), options, cancellation));
    if (report.damage_count > 0) {
      return absl::DataLossError(damage);
    }
    if (report.shard_count != 1) {
      return absl::DataLossError(
          absl::StrCat(VolumePath(key, shard), ": no ", store::kShardFileName, " in it"));
    }
  }
  return absl::OkStatus();
}

absl::Status SeriesWorkFolder::Finish(const store::ScalarVolumeKey& key,
                                      absl::string_view fingerprint) {
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(RecordPath(key)));
  for (int shard = 0; shard < shard_count_; ++shard) {
    const std::string to = VolumePath(key, shard);
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(to));
    ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(
        absl::StrCat(volume_path(), "/", store::ShardDirectoryName(shard, shard_count_)), to));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const store::ScalarVolume volume, Describe(key));
  ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(RecordPath(key), RecordOf(fingerprint, volume)));
  return io::RemoveRecursively(volume_path());
}

absl::StatusOr<store::ScalarVolume> SeriesWorkFolder::Describe(
    const store::ScalarVolumeKey& key) const {
  const std::string path = absl::StrCat(VolumePath(key, 0), "/", store::kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, ReadManifest(key, 0));
  store::ScalarVolume volume;
  ISOSCOPE_ASSIGN_OR_RETURN(volume.manifest_crc32c, store::ManifestCrc32c(bytes, path));
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest, store::DecodeManifest(bytes, path));
  volume.key = key;
  volume.dataset_id = std::move(manifest.dataset_id);
  volume.value_range = manifest.value_range;
  volume.finite_range = manifest.finite_range;
  volume.max_gradient_magnitude = manifest.max_gradient_magnitude;
  volume.highest_level = manifest.highest_level();
  volume.level_filter = manifest.level_filter;
  return volume;
}

absl::Status SeriesWorkFolder::MoveTo(const std::string& to) {
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(path_, to));
  is_moved_ = true;
  for (const absl::string_view name : {kFinishedName, kLockName}) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(absl::StrCat(to, "/", name)));
  }
  return io::SyncDirectory(to);
}

}  // namespace isoscope::partition
