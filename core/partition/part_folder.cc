#include "core/partition/part_folder.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <random>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/block_order.h"

namespace isoscope::partition {
namespace {

constexpr char kPartialSuffix[] = ".partial";
constexpr char kJoinedSuffix[] = ".joined";  // of the parts, while they are removed

// Makes a folder; another process may do the same.
absl::Status EnsureFolder(const std::string& path) {
  const absl::Status status = io::CreateDirectory(path);
  return absl::IsAlreadyExists(status) && io::IsDirectory(path) ? absl::OkStatus() : status;
}

// The names in a folder, ascending. A network file system shows new names to whoever lists it.
absl::StatusOr<std::vector<std::string>> NamesIn(const std::string& path) {
  std::error_code error;
  std::vector<std::string> names;
  for (std::filesystem::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    names.push_back(entry->path().filename().string());
  }
  if (error) {
    return io::ErrnoToStatus(error.value(), "list", path);
  }
  std::sort(names.begin(), names.end());
  return names;
}

// Adds what the processes say that work on parts of a volume.
absl::Status AddTries(const PartFolder& folder, const std::string& volume, PartsState* state) {
  const std::string path = folder.VolumePath(volume);
  if (!io::IsDirectory(path)) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesIn(path));
  for (const std::string& name : names) {
    const std::optional<store::PartNumber> part = store::PartOfName(name);
    if (!part.has_value() || part->count != state->cut.part.count) {
      continue;
    }
    PartState& of_part = state->parts[static_cast<std::size_t>(part->index)];
    if (name == store::PartName(*part)) {
      ++of_part.finished_volumes;
      continue;
    }
    const std::string progress_path =
        absl::StrCat(path, "/", name, "/", store::kPartProgressFileName);
    const absl::StatusOr<std::string> bytes =
        io::ReadWholeFile(progress_path, store::kMaxPartFileBytes);
    const absl::StatusOr<store::PartProgress> progress =
        bytes.ok() ? store::DecodePartProgress(*bytes, progress_path) : bytes.status();
    if (progress.ok()) {  // it may have ended just now
      of_part.tries.push_back(*progress);
    }
  }
  return absl::OkStatus();
}

}  // namespace

LayerRange LayersOfPart(const volume::BlockLayout& layout, const store::PartNumber& part) {
  const std::int64_t layers = layout.block_dims().z;
  const std::int64_t cubes = (layers + store::kCubeEdge - 1) / store::kCubeEdge;
  const auto begin_of = [&](std::int64_t index) {
    return std::min(cubes * index / part.count * store::kCubeEdge, layers);
  };
  return {.begin = begin_of(part.index), .end = begin_of(part.index + 1)};
}

PartFolder::PartFolder(std::string output) : output_(std::move(output)) {
  while (output_.size() > 1 && output_.back() == '/') {
    output_.pop_back();
  }
  if (absl::EndsWith(output_, kPartialSuffix) && io::IsDirectory(output_ + "/parts")) {
    output_.resize(output_.size() - (sizeof(kPartialSuffix) - 1));
  }
}

bool PartFolder::Exists() const { return io::IsDirectory(parts_path()); }

absl::Status PartFolder::Make(const std::vector<std::string>& volumes) const {
  ISOSCOPE_RETURN_IF_ERROR(EnsureFolder(path()));
  if (!Exists()) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(parts_path() + kJoinedSuffix));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesIn(path()));
    if (!names.empty() && names != std::vector<std::string>{"parts"}) {
      return absl::FailedPreconditionError(
          absl::StrCat(path(), ": holds the work of a run without --part (", names.front(),
                       "): end it with --resume, or remove that folder, before parts are cut"));
    }
    ISOSCOPE_RETURN_IF_ERROR(EnsureFolder(parts_path()));
  }
  for (const std::string& volume : volumes) {
    ISOSCOPE_RETURN_IF_ERROR(EnsureFolder(VolumePath(volume)));
  }
  return absl::OkStatus();
}

absl::Status PartFolder::Remove() const {
  // Parts vanish in one step, so that none are left that look unfinished.
  const std::string joined = parts_path() + kJoinedSuffix;
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(joined));
  if (Exists()) {
    absl::Status renamed = io::RenamePath(parts_path(), joined);
    if (!renamed.ok() && Exists()) {
      return renamed;
    }  // else another process removes them, too
    absl::Status removed = io::RemoveRecursively(joined);
    if (!removed.ok() && io::PathExists(joined)) {
      return removed;
    }
  }
  std::error_code error;
  std::filesystem::remove(path(), error);  // stays if there is something else in it
  return absl::OkStatus();
}

std::string PartFolder::CutPath(const store::PartNumber& part) const {
  return absl::StrCat(parts_path(), "/", store::PartName(part), ".json");
}

std::string PartFolder::VolumePath(const std::string& volume) const {
  return absl::StrCat(parts_path(), "/", volume);
}

std::string PartFolder::PiecePath(const std::string& volume, const store::PartNumber& part) const {
  return absl::StrCat(VolumePath(volume), "/", store::PartName(part));
}

absl::Status PartFolder::WriteCut(const store::PartCut& cut) const {
  const std::string path = CutPath(cut.part);
  const std::string bytes = store::EncodePartCut(cut);
  const absl::StatusOr<std::string> written = io::ReadWholeFile(path, store::kMaxPartFileBytes);
  if (written.ok() && *written == bytes) {
    return absl::OkStatus();
  }
  // A name of its own: containers on two machines have the same process ids.
  std::random_device random;
  const std::string unfinished =
      absl::StrFormat("%s%s%08x%08x", path, kTryInfix, random(), random());
  ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(unfinished, bytes));
  return io::RenamePath(unfinished, path);
}

absl::StatusOr<std::vector<store::PartCut>> PartFolder::ReadCuts() const {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesIn(parts_path()));
  std::vector<store::PartCut> cuts;
  for (const std::string& name : names) {
    const std::optional<store::PartNumber> part = store::PartOfName(name);
    if (!part.has_value() || name != store::PartName(*part) + ".json") {
      continue;  // a volume, or a file that is not whole yet
    }
    const std::string path = CutPath(*part);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                              io::ReadWholeFile(path, store::kMaxPartFileBytes));
    ISOSCOPE_ASSIGN_OR_RETURN(cuts.emplace_back(), store::DecodePartCut(bytes, path));
  }
  return cuts;
}

absl::StatusOr<std::optional<store::PieceRecord>> PartFolder::ReadPiece(
    const std::string& volume, const store::PartNumber& part) const {
  const std::string path = absl::StrCat(PiecePath(volume, part), "/", store::kPieceFileName);
  const absl::StatusOr<std::string> bytes = io::ReadWholeFile(path, store::kMaxPartFileBytes);
  if (absl::IsNotFound(bytes.status())) {
    return std::nullopt;
  }
  ISOSCOPE_RETURN_IF_ERROR(bytes.status());
  ISOSCOPE_ASSIGN_OR_RETURN(store::PieceRecord record, store::DecodePieceRecord(*bytes, path));
  return record;
}

std::vector<std::string> VolumesOf(const store::PartCut& cut) {
  if (!cut.series.has_value()) {
    return {kOnlyVolumeFolder};
  }
  std::vector<std::string> volumes;
  volumes.reserve(cut.keys.size());
  for (const store::ScalarVolumeKey& key : cut.keys) {
    volumes.push_back(store::ScalarVolumeDirectoryName(key));
  }
  return volumes;
}

absl::Status CheckSameCut(const store::PartCut& a, const store::PartCut& b,
                          const PartFolder& folder) {
  const auto differs = [&](absl::string_view what, absl::string_view of_a, absl::string_view of_b) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s: part %d of %d and part %d of %d are not of one dataset: %s is %s there and %s here; "
        "give all parts the same source and flags, or remove %s and begin again",
        folder.parts_path(), a.part.index, a.part.count, b.part.index, b.part.count, what, of_a,
        of_b, folder.path()));
  };
  if (a.part.count != b.part.count) {
    return differs("the number of parts", absl::StrCat(a.part.count), absl::StrCat(b.part.count));
  }
  for (std::size_t i = 0; i < std::min(a.members.size(), b.members.size()); ++i) {
    if (a.members[i] != b.members[i]) {
      return differs(b.members[i].first, a.members[i].second, b.members[i].second);
    }
  }
  if (a.Digest() != b.Digest()) {
    return differs("the list of fields, steps or files", "another", "this");
  }
  return absl::OkStatus();
}

absl::StatusOr<PartsState> ReadPartsState(const PartFolder& folder) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<store::PartCut> cuts, folder.ReadCuts());
  if (cuts.empty()) {
    return absl::NotFoundError(absl::StrCat(
        folder.parts_path(),
        ": no part has begun; cut one with `isoscope partition SOURCE --part 0/N --output ",
        folder.output(), "`"));
  }
  PartsState state;
  state.cut = cuts.front();
  for (const store::PartCut& cut : cuts) {
    ISOSCOPE_RETURN_IF_ERROR(CheckSameCut(state.cut, cut, folder));
  }
  const std::vector<std::string> volumes = VolumesOf(state.cut);
  state.volume_count = static_cast<int>(volumes.size());
  for (int index = 0; index < state.cut.part.count; ++index) {
    state.parts.push_back({.part = {.index = index, .count = state.cut.part.count}, .tries = {}});
  }
  for (const store::PartCut& cut : cuts) {
    state.parts[static_cast<std::size_t>(cut.part.index)].has_begun = true;
  }
  for (const std::string& volume : volumes) {
    ISOSCOPE_RETURN_IF_ERROR(AddTries(folder, volume, &state));
  }
  for (PartState& part : state.parts) {
    std::sort(part.tries.begin(), part.tries.end(),
              [](const store::PartProgress& a, const store::PartProgress& b) {
                return a.updated_unix_seconds > b.updated_unix_seconds;
              });
  }
  return state;
}

}  // namespace isoscope::partition
