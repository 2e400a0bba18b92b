// The directory of a series has a manifest, which names volumes, and a folder for each that is
// there. Partitioning and copies add folders while the agent serves.
//
//   Refresh      reads the manifest again if its file has changed, or if folders were missing; one
//                thread at a time, others go on with the volumes known before
//   FindVolumes  keeps the volumes whose folders have a manifest, which is written last
//   OpenVolume   opens the files of a volume when a frame first needs it: OpenOnce lets others wait
//                for the same volume, so that they find it open; Opening::kAhead does not wait
//   OpenVolumes  keeps the volumes used last, by their memory; a frame's pointers keep the files of
//                volumes that were closed here
//
// Invariant: a volume keeps its shard number for the life of the agent, so that caches know its
// blocks again after it was closed.

#include "partition-agent/shard/series_shard.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "core/store/source_volume.h"
#include "core/volume/volume_level.h"

namespace isoscope::agent {
namespace {

// The pages of its interval tree that a shard keeps, and its tables for each block of the shard
// and of the volume.
constexpr std::size_t kTreeBytes = std::size_t{1} << 20;
constexpr std::size_t kBytesPerOwnBlock = 32;
constexpr std::size_t kBytesPerBlock = 8 + 16 / 8;  // a range, and the sets of active blocks

std::size_t BytesOf(const Shard& shard) {
  const store::ShardReader& reader = *shard.reader;
  const std::size_t range_bytes = 2 * volume::SizeOf(reader.manifest().scalar_type);
  return kTreeBytes + kBytesPerOwnBlock * static_cast<std::size_t>(reader.block_count()) +
         (kBytesPerBlock + range_bytes) * static_cast<std::size_t>(reader.layout().block_count());
}

// Says which volumes are missing: a copy is under way, or a folder was lost. Steps without them are
// not drawn, and the last step may be an earlier one than that of the manifest.
void WarnIfIncomplete(const SeriesShard::Served& served, const std::string& directory) {
  const std::vector<store::ScalarVolume>& named = served.manifest.volumes;
  if (served.volumes.size() == named.size()) {
    return;
  }
  const auto missing = std::find_if(named.begin(), named.end(), [&](const auto& volume) {
    return std::none_of(served.volumes.begin(), served.volumes.end(),
                        [&](const auto& found) { return found.key == volume.key; });
  });
  base::LogWarning("series_lacks_volumes",
                   {{"dataset", served.manifest.name},
                    {"directory", directory},
                    {"missing", named.size() - served.volumes.size()},
                    {"of", named.size()},
                    {"first", store::ScalarVolumeDirectoryName(missing->key)}});
}

std::string ManifestPath(const std::string& directory) {
  return absl::StrCat(directory, "/", store::kManifestFileName);
}

}  // namespace

std::shared_ptr<const Shard> OpenVolumes::Find(std::uint32_t number) {
  const base::MutexLock lock(&mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
    return entry.shard->number == number;
  });
  if (found == entries_.end()) {
    return nullptr;
  }
  entries_.splice(entries_.begin(), entries_, found);
  return found->shard;
}

std::shared_ptr<const Shard> OpenVolumes::Add(std::shared_ptr<const Shard> shard) {
  const std::size_t bytes = BytesOf(*shard);
  std::vector<std::shared_ptr<const Shard>> closed;  // without the lock: files are closed
  const base::MutexLock lock(&mutex_);
  for (const Entry& entry : entries_) {
    if (entry.shard->number == shard->number) {
      return entry.shard;
    }
  }
  entries_.push_front({.shard = std::move(shard), .bytes = bytes});
  bytes_ += bytes;
  while (bytes_ > max_bytes_ && entries_.size() > 1) {
    bytes_ -= entries_.back().bytes;
    closed.push_back(std::move(entries_.back().shard));
    entries_.pop_back();
  }
  return entries_.front().shard;
}

bool OpenVolumes::HasRoomForAnother(const std::vector<std::shared_ptr<const Shard>>& shards) const {
  std::size_t bytes = 0;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    bytes += BytesOf(*shard);
  }
  return 2 * bytes <= max_bytes_;
}

absl::StatusOr<std::unique_ptr<SeriesShard>> SeriesShard::Open(
    const std::string& directory, std::shared_ptr<OpenVolumes> open_volumes,
    ReadManifest read_manifest, store::OpenSamples open_samples) {
  std::unique_ptr<SeriesShard> series(new SeriesShard(
      directory, std::move(open_volumes), std::move(read_manifest), std::move(open_samples)));
  const base::MutexLock refreshing(&series->refreshing_);
  // The stamp comes first: a manifest that is replaced while it is read is read again.
  series->stamp_ = io::StampOf(ManifestPath(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesShard shard, series->read_manifest_(directory));
  series->shard_index_ = shard.shard_index;
  const base::MutexLock lock(&series->mutex_);
  series->served_ = series->FindVolumes(std::move(shard));
  WarnIfIncomplete(*series->served_, directory);
  if (!series->served_->volumes.empty()) {
    // If it can't be read, a frame that needs the volume tells.
    const auto samples = store::SamplesOfVolume(directory, series->served_->volumes.front().key);
    if (samples.ok() && samples->has_value()) {
      series->source_ = (*samples)->request.at("path");
    }
  }
  return series;
}

std::shared_ptr<const SeriesShard::Served> SeriesShard::FindVolumes(
    store::SeriesShard shard) const {
  auto served = std::make_shared<Served>();
  served->manifest = std::move(shard.manifest);
  served->manifest_crc32c = shard.manifest_crc32c;
  for (const store::ScalarVolume& volume : served->manifest.volumes) {
    // Partitioning and careful copies write the manifest of a folder last.
    const std::string directory = DirectoryOf(volume);
    if (!io::PathExists(ManifestPath(directory))) {
      served->lacks_folders = true;
      continue;
    }
    served->volumes.push_back(volume);
    std::vector<int>& levels = served->levels.emplace_back();
    for (int level = 1; level <= volume.highest_level; ++level) {
      if (io::PathExists(ManifestPath(store::LevelDirectory(directory, level)))) {
        levels.push_back(level);
      } else {
        served->lacks_folders = true;
      }
    }
  }
  return served;
}

std::shared_ptr<const SeriesShard::Served> SeriesShard::served() const {
  const base::MutexLock lock(&mutex_);
  return served_;
}

absl::StatusOr<store::SeriesShard> SeriesShard::ReadAgain(const Served& before) const {
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesShard shard, read_manifest_(directory_));
  if (shard.manifest.dataset_id != before.manifest.dataset_id ||
      shard.shard_index != shard_index_) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory_, ": holds shard ", shard.shard_index, " of dataset id ",
                     shard.manifest.dataset_id, " now, was shard ", shard_index_, " of ",
                     before.manifest.dataset_id, ": restart the agent to serve it"));
  }
  return shard;
}

void SeriesShard::Refresh() {
  if (refreshing_.TryLock()) {
    RefreshAlone();
    refreshing_.Unlock();
  }
}

void SeriesShard::RefreshAlone() {
  const std::shared_ptr<const Served> before = served();
  const io::FileStamp stamp = io::StampOf(ManifestPath(directory_));
  if (stamp == stamp_ && !before->lacks_folders) {
    return;
  }
  absl::StatusOr<store::SeriesShard> shard = ReadAgain(*before);
  if (!shard.ok()) {
    if (std::string error = shard.status().ToString(); error != last_error_) {
      last_error_ = std::move(error);
      base::LogWarning("series_not_read_again",
                       {{"directory", base::OwnText{directory_}}, {"status", shard.status()}});
    }
    return;  // with the old stamp: the next call tries again
  }
  stamp_ = stamp;
  last_error_.clear();
  std::shared_ptr<const Served> after = FindVolumes(*std::move(shard));
  if (after->volumes.size() != before->volumes.size()) {
    base::LogInfo("series_changed", {{"dataset", after->manifest.name},
                                     {"shard", shard_index_},
                                     {"volumes_before", before->volumes.size()},
                                     {"volumes", after->volumes.size()},
                                     {"steps", after->manifest.step_count()}});
    WarnIfIncomplete(*after, directory_);
  }
  const base::MutexLock lock(&mutex_);
  served_ = std::move(after);
}

const store::ScalarVolume* SeriesShard::VolumeIn(const Served& served,
                                                 const std::string& dataset_id) {
  const auto found = std::find_if(
      served.volumes.begin(), served.volumes.end(),
      [&](const store::ScalarVolume& volume) { return volume.dataset_id == dataset_id; });
  return found == served.volumes.end() ? nullptr : &*found;
}

bool SeriesShard::Has(const std::string& dataset_id) const {
  return VolumeIn(*served(), dataset_id) != nullptr;
}

std::optional<SeriesShard::Place> SeriesShard::PlaceOf(const std::string& dataset_id) const {
  const std::shared_ptr<const Served> served = this->served();
  const store::ScalarVolume* const volume = VolumeIn(*served, dataset_id);
  if (volume == nullptr) {
    return std::nullopt;
  }
  Place place{.key = volume->key, .steps = {}};
  for (const store::ScalarVolume& other : served->volumes) {
    if (other.key.field == volume->key.field && other.key.component == volume->key.component) {
      place.position = &other == volume ? place.steps.size() : place.position;
      place.steps.push_back(other.key.step);
    }
  }
  return place;
}

std::string SeriesShard::IdOf(const store::ScalarVolumeKey& key) const {
  const std::shared_ptr<const Served> served = this->served();
  const auto found =
      std::find_if(served->volumes.begin(), served->volumes.end(),
                   [&](const store::ScalarVolume& volume) { return volume.key == key; });
  return found == served->volumes.end() ? "" : found->dataset_id;
}

double SeriesShard::ValueScaleOf(const std::string& dataset_id, int level) const {
  const std::shared_ptr<const Served> served = this->served();
  const store::ScalarVolume* const volume = VolumeIn(*served, dataset_id);
  if (level == 0 || volume == nullptr) {
    return 1;
  }
  const store::Field& field = served->manifest.fields[static_cast<std::size_t>(volume->key.field)];
  return volume::LevelValueScale(
      field.components[static_cast<std::size_t>(volume->key.component)].scalar_type,
      volume->level_filter);
}

std::string SeriesShard::DirectoryOf(const store::ScalarVolume& volume) const {
  return absl::StrCat(directory_, "/", store::ScalarVolumeDirectoryName(volume.key));
}

absl::StatusOr<std::shared_ptr<const Shard>> SeriesShard::OpenVolume(const std::string& dataset_id,
                                                                     Opening opening, int level) {
  const std::shared_ptr<const Served> served = this->served();
  const store::ScalarVolume* const volume = VolumeIn(*served, dataset_id);
  if (volume == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat("dataset id ", base::Quoted(dataset_id),
                                                      " is not served by this agent (any more)"));
  }
  std::uint32_t number = 0;
  {
    const base::MutexLock lock(&mutex_);
    const auto filter = level == 0 ? volume::LevelFilter::kMean : volume->level_filter;
    const auto [entry, is_new] = numbers_.try_emplace({dataset_id, level, filter}, 0);
    if (is_new) {
      entry->second = NextShardNumber();
    }
    number = entry->second;
  }
  const VolumeToOpen wanted{
      .volume = *volume, .level = level, .number = number, .opening = opening};
  return opening == Opening::kAhead ? OpenNow(wanted) : OpenOnce(wanted);
}

absl::StatusOr<std::shared_ptr<const Shard>> SeriesShard::OpenOnce(const VolumeToOpen& wanted) {
  const std::uint32_t number = wanted.number;
  {
    const base::MutexLock lock(&mutex_);
    opened_.Await(&mutex_,
                  [&]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return !opening_.contains(number); });
    opening_.insert(number);
  }
  const absl::Cleanup end = [&] {
    const base::MutexLock lock(&mutex_);
    opening_.erase(number);
    opened_.SignalAll();
  };
  return OpenNow(wanted);
}

absl::StatusOr<std::shared_ptr<const Shard>> SeriesShard::OpenNow(const VolumeToOpen& wanted) {
  if (std::shared_ptr<const Shard> open = open_volumes_->Find(wanted.number)) {
    return open;
  }
  if (wanted.level == 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Shard> shard, ReadVolume(wanted));
    return open_volumes_->Add(std::move(shard));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Shard> whole,
                            OpenVolume(wanted.volume.dataset_id, wanted.opening));
  const store::Manifest& manifest = whole->reader->manifest();
  if (manifest.highest_level() != wanted.volume.highest_level ||
      manifest.level_filter != wanted.volume.level_filter) {
    // Levels were added or dropped since: a frame of level 0 needs nothing of that, this one does.
    ISOSCOPE_ASSIGN_OR_RETURN(whole, ReadVolume(wanted));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Shard> shard,
                            OpenLevel(*whole, wanted.level, wanted.number));
  return open_volumes_->Add(std::move(shard));
}

absl::StatusOr<std::shared_ptr<const Shard>> SeriesShard::ReadVolume(
    const VolumeToOpen& wanted) const {
  const store::ScalarVolume& volume = wanted.volume;
  const std::string directory = DirectoryOf(volume);
  absl::StatusOr<std::shared_ptr<const Shard>> opened =
      OpenShard(directory, wanted.number, io::OpenRandomAccessFile, open_samples_);
  if (!opened.ok() && is_index_only() && !absl::StrContains(opened.status().message(), directory)) {
    // The source is a part of the shard: whoever is told knows whose error it is.
    return base::WithPrefix(absl::StrCat(directory, ": "), opened.status());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Shard> shard, std::move(opened));
  if (shard->reader->manifest_crc32c() != volume.manifest_crc32c ||
      shard->reader->shard_index() != shard_index_) {
    return absl::DataLossError(absl::StrCat(
        directory, ": holds shard ", shard->reader->shard_index(), " of dataset id ",
        shard->reader->manifest().dataset_id, ", the series expects shard ", shard_index_, " of ",
        volume.dataset_id, "; copy the whole shard directory again"));
  }
  if (on_opened_) {
    on_opened_(directory);
  }
  return shard;
}

}  // namespace isoscope::agent
