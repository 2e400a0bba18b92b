#include "partition-agent/opening.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/store/directory_files.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "core/store/span_tree_file.h"
#include "core/volume/volume_level.h"

namespace isoscope::agent {
namespace {

// A disk gives as much in a moment, so that a cancelled opening ends soon.
constexpr std::size_t kPartBytes = std::size_t{1} * base::kMiB;

bool IsTable(const std::string& path) {
  return absl::EndsWith(path, absl::StrCat("/", store::kRangeTableFileName)) ||
         absl::EndsWith(path, absl::StrCat("/", store::kBlockIndexFileName));
}

std::int64_t SizeOf(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  return error ? 0 : static_cast<std::int64_t>(size);
}

// The name of the dataset of a shard; "" if its manifest can't be read: opening it says why.
std::string NameOfDataset(const std::string& directory) {
  if (store::IsSeriesDirectory(directory)) {
    const absl::StatusOr<store::SeriesShard> series = store::OpenSeriesShard(directory);
    return series.ok() ? series->manifest.name : "";
  }
  const std::string path = store::PathIn(directory, store::kManifestFileName);
  const auto bytes =
      store::ReadRequiredJson(path, store::kMaxManifestBytes, io::OpenRandomAccessFile);
  if (!bytes.ok()) {
    return "";
  }
  const auto manifest = store::DecodeManifest(*bytes, path);
  return manifest.ok() ? manifest->name : "";
}

// Reads in parts, counts them, and looks at the cancellation before each.
class CountedFile final : public io::RandomAccessFile {
 public:
  CountedFile(std::unique_ptr<io::RandomAccessFile> file, const base::Cancellation& cancellation,
              std::atomic<std::int64_t>* read_bytes)
      : file_(std::move(file)), cancellation_(cancellation), read_bytes_(read_bytes) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    while (size > 0) {
      if (cancellation_.is_cancelled()) {
        return absl::CancelledError("the opening was cancelled");
      }
      const std::size_t part = std::min(size, kPartBytes);
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(offset, part, out));
      read_bytes_->fetch_add(static_cast<std::int64_t>(part));
      offset += static_cast<std::int64_t>(part);
      out += part;
      size -= part;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return file_->path(); }

 private:
  const std::unique_ptr<io::RandomAccessFile> file_;
  const base::Cancellation& cancellation_;
  std::atomic<std::int64_t>* const read_bytes_;
};

}  // namespace

std::string ToString(const OpeningProgress& progress) {
  const auto mebibytes = [](std::int64_t bytes) {
    return absl::StrFormat("%.1f MiB",
                           static_cast<double>(bytes) / static_cast<double>(base::kMiB));
  };
  return absl::StrCat(progress.open_shard_count, " of ", progress.shard_count, " shards are open, ",
                      mebibytes(progress.read_bytes), " of ", mebibytes(progress.table_bytes),
                      " of tables are read");
}

void Opening::Begin(const std::vector<std::string>& shard_directories) {
  OpeningProgress plan;
  plan.shard_count = static_cast<int>(shard_directories.size());
  std::set<std::string> datasets;
  for (const std::string& directory : shard_directories) {
    for (int level = 0; level <= volume::kMaxLevel; ++level) {
      const std::string tables = store::LevelDirectory(directory, level);
      plan.table_bytes += SizeOf(store::PathIn(tables, store::kBlockIndexFileName));
      if (!io::PathExists(store::PathIn(tables, store::kSpanTreeFileName))) {
        plan.table_bytes += SizeOf(store::PathIn(tables, store::kRangeTableFileName));
      }
    }
    if (std::string name = NameOfDataset(directory); !name.empty()) {
      datasets.insert(std::move(name));
    }
  }
  plan.datasets.assign(datasets.begin(), datasets.end());
  const base::MutexLock lock(&mutex_);
  plan_ = std::move(plan);
}

absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> Opening::OpenFile(
    const std::string& path, const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  if (!IsTable(path)) {
    return file;
  }
  return std::make_unique<CountedFile>(std::move(file), cancellation, &read_bytes_);
}

OpeningProgress Opening::progress() const {
  const base::MutexLock lock(&mutex_);
  OpeningProgress progress = plan_;
  progress.open_shard_count = open_shard_count_.load();
  progress.read_bytes = read_bytes_.load();
  return progress;
}

}  // namespace isoscope::agent
