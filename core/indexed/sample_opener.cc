// A manifest names a source, and may come from anybody. So nothing is opened before it is allowed:
//
//   1. DecodeSourceRequest: the members of the manifest become a request.
//   2. The recorded path is moved (RECORDED=ACTUAL), its links are resolved, and it must lie below
//      what is allowed.
//   3. FilesOf: the headers name further files. All of them must be allowed, too.
//   4. Open: one volume, with random access, of the dimensions and the type of the manifest. Volumes
//      of a series come from one source, which is kept open for the next one.
//
// A block is copied from one unit: the caller has its other samples (core/store/block_overhang.h), and
// compares its checksum, so samples that have changed are never drawn.

#include "core/indexed/sample_opener.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/cancellation.h"
#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/thread_interrupt.h"
#include "core/formats/address_opening.h"
#include "core/formats/address_source.h"
#include "core/formats/missing_steps.h"
#include "core/formats/open_request.h"
#include "core/formats/reader_memory.h"
#include "core/indexed/source_request.h"
#include "core/indexed/unit_cache.h"
#include "core/math/box.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/source/series_parts.h"
#include "core/source/source_stamps.h"
#include "core/source/volume_source.h"
#include "core/store/block_overhang.h"
#include "core/store/manifest.h"
#include "core/store/source_volume.h"

namespace isoscope::indexed {
namespace {

// Whether a path is `prefix` or lies below it.
bool IsBelow(absl::string_view path, absl::string_view prefix) {
  prefix = absl::StripSuffix(prefix, "/");
  // "run.h5:/p" and "a.zarr/0" are of "run.h5" and "a.zarr".
  return absl::ConsumePrefix(&path, prefix) && (path.empty() || path[0] == '/' || path[0] == ':');
}

// A source that gives other samples is opened again at most this often, whatever the number of blocks.
constexpr absl::Duration kReopeningPause = absl::Seconds(5);

// More than any bound of memory.
constexpr std::int64_t kMostBytes = std::int64_t{1} << 60;

// INVALID_ARGUMENT: the series, which `request` opened, has no such volume.
absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenFrom(const source::OpenRequest& request,
                                                               source::VolumeSeries& series,
                                                               const SourceVolume& wanted) {
  const source::SeriesInfo& info = series.info();
  const auto field =
      std::find_if(info.fields.begin(), info.fields.end(),
                   [&](const source::SourceField& f) { return f.name == wanted.field; });
  if (field == info.fields.end()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: has no field \"%s\" any more; it has %s",
                                                      info.name, wanted.field,
                                                      source::DescribeFields(info.fields)));
  }
  const auto components = static_cast<int>(field->components.size());
  const int count = components + (components > 1 ? 1 : 0);  // and the magnitude
  if (wanted.component >= count) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: has %d components of field \"%s\", expected component %d", info.name,
                        components, wanted.field, wanted.component));
  }
  if (wanted.step >= info.step_count()) {
    return absl::InvalidArgumentError(
        absl::StrCat(info.name, ": ",
                     source::DescribeMissingSteps(request, info.step_count(), wanted.step + 1)));
  }
  return source::OpenComponent(series, static_cast<int>(field - info.fields.begin()),
                               wanted.component, wanted.step);
}

// What is known of a source before it is opened, for messages.
struct SourceNames {
  std::string dataset;
  std::string recorded;  // path in the manifest
  std::string actual;    // where it is read
};

absl::Status Unreadable(const absl::Status& status) {
  return base::WithReason(status, base::ErrorReason::kSourceUnreadable);
}

// Returns an error of the source with what to do about it. What another volume would give is
// DATA_LOSS.
absl::Status Explain(const SourceNames& names, const absl::Status& status) {
  const std::string where = absl::StrCat("index-only dataset ", names.dataset);
  const std::string in_source = absl::StrCat(where, ": its samples are in ", names.recorded, ": ");
  const auto changed = [&] {
    return absl::DataLossError(
        absl::StrCat(where, ": the source has changed or is damaged: ", status.message(),
                     "; bring it back as it was, or partition it anew"));
  };
  switch (status.code()) {
    case absl::StatusCode::kNotFound:
      return Unreadable(absl::NotFoundError(absl::StrCat(
          in_source, status.message(),
          "; bring it back, or say where it is now: ISOSCOPE_ALLOW_SOURCE=", names.recorded,
          "=NEW (of isoscope-agent also --allow-source)")));
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnauthenticated:
      return Unreadable(absl::Status(
          status.code(),
          absl::StrCat(in_source, status.message(), "; give this program ",
                       IsAddress(names.actual) ? "credentials that may read it (docs/remote.md)"
                                               : "the right to read it")));
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kDataLoss:
      return changed();
    case absl::StatusCode::kFailedPrecondition:  // a folder or a pipe stands in its place
      return IsAddress(names.actual)
                 ? Unreadable(base::WithPrefix(absl::StrCat(where, ": "), status))
                 : changed();
    case absl::StatusCode::kUnavailable:
      return Unreadable(base::WithPrefix(absl::StrCat(where, ": "), status));
    default:
      return base::WithPrefix(absl::StrCat(where, ": "), status);
  }
}

struct OpenSource {
  SourceNames names;
  std::int64_t number = 0;
  bool is_local = true;
  // Bytes that are decoded, over those of the samples that are read.
  double decoding_factor = 1;
  source::OpenRequest request;
  int step = 0;
  int step_count = 1;
  std::unique_ptr<source::VolumeSource> volume;
};

// DATA_LOSS if files are missing between those of a source of which each file is a step: a step
// behind a gap is another file, of which only samples tell that.
absl::Status CheckSteps(const OpenSource& source) {
  const bool has_files = source.is_local && source.step_count > 1;
  const std::string gap =
      has_files ? source::DescribeGap(source.request, source.step_count) : std::string();
  if (gap.empty()) {
    return absl::OkStatus();
  }
  return Explain(source.names, absl::DataLossError(absl::StrCat(
                                   source.request.path, ": step ", source.step,
                                   " has other samples than were partitioned, and ", gap)));
}

// A volume of a source, and of how many steps it is one.
struct OpenVolume {
  std::unique_ptr<source::VolumeSource> volume;
  int step_count = 1;
};

// Sources of series that are kept open, though none of their volumes is.
constexpr std::size_t kKeptSeries = 4;

// A mutex for what takes long: threads that wait for their turn heed their interrupt, and end with it.
class ABSL_LOCKABLE Turn {
 public:
  // Waits for the turn. AssertHeld and Release follow an OK.
  [[nodiscard]] absl::Status Take() ABSL_LOCKS_EXCLUDED(mutex_) {
    return base::AwaitOrCancelled(
        base::ProcessInterrupt(), &mutex_, &released_,
        [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !std::exchange(is_taken_, true); });
  }
  void AssertHeld() const ABSL_ASSERT_EXCLUSIVE_LOCK() {}
  void Release() ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const base::MutexLock lock(&mutex_);
      is_taken_ = false;
    }
    released_.SignalAll();
  }

 private:
  base::Mutex mutex_;
  base::CondVar released_;
  bool is_taken_ ABSL_GUARDED_BY(mutex_) = false;
};

// Releases a turn that was taken, also after an exception.
class TurnEnd {
 public:
  explicit TurnEnd(Turn* turn) : turn_(turn) {}
  ~TurnEnd() { turn_->Release(); }
  TurnEnd(const TurnEnd&) = delete;
  TurnEnd& operator=(const TurnEnd&) = delete;

 private:
  Turn* const turn_;
};

// What the readers of one opener share.
class Sources {
 public:
  explicit Sources(const SourceAccess& access) : access_(access), units_(access.max_bytes) {}

  absl::StatusOr<std::shared_ptr<const OpenSource>> Open(const store::Manifest& manifest)
      ABSL_LOCKS_EXCLUDED(turn_);
  // Opens a source once more, unless somebody did since source `number` was opened.
  absl::StatusOr<std::shared_ptr<const OpenSource>> OpenAgain(const store::Manifest& manifest,
                                                              std::int64_t number)
      ABSL_LOCKS_EXCLUDED(turn_);
  [[nodiscard]] UnitCache& units() { return units_; }

 private:
  // Returns an open source; null if it is not open.
  [[nodiscard]] std::shared_ptr<const OpenSource> Find(const std::string& key) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(turn_);
  absl::StatusOr<std::shared_ptr<const OpenSource>> OpenAs(const std::string& key,
                                                           const store::Manifest& manifest)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(turn_);
  absl::StatusOr<std::shared_ptr<const OpenSource>> OpenNow(const store::Manifest& manifest)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(turn_);
  // The only volume of a source.
  [[nodiscard]] absl::StatusOr<OpenVolume> OpenOnly(const source::OpenRequest& request,
                                                    absl::string_view where) const;
  // A volume of a series. members: of the request
  absl::StatusOr<OpenVolume> OpenOneOf(const source::OpenRequest& request,
                                       std::map<std::string, std::string> members,
                                       const SourceVolume& wanted, absl::string_view where)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(turn_);
  [[nodiscard]] absl::StatusOr<std::shared_ptr<source::VolumeSeries>> OpenSeries(
      const source::OpenRequest& request, absl::string_view where) const;
  [[nodiscard]] std::string PathOf(const std::string& recorded) const;
  [[nodiscard]] absl::Status CheckAllowed(const std::string& path, absl::string_view where) const;

  const SourceAccess access_;
  UnitCache units_;
  Turn turn_;  // taken while a source is opened: each is opened once
  std::map<std::string, std::weak_ptr<const OpenSource>> open_ ABSL_GUARDED_BY(turn_);
  // By the members of the request, the last used first.
  std::list<std::pair<std::map<std::string, std::string>, std::shared_ptr<source::VolumeSeries>>>
      series_ ABSL_GUARDED_BY(turn_);
  std::int64_t next_number_ ABSL_GUARDED_BY(turn_) = 0;
};

// Of the source of a dataset, and of all that its units depend on: a forged manifest may have the id
// of another one.
std::string KeyOfSource(const store::Manifest& manifest) {
  std::string key = absl::StrCat(manifest.dataset_id, "\n", volume::NameOf(manifest.scalar_type));
  for (const math::Index3& numbers :
       {manifest.geometry.sample_dims, manifest.in_source->unit_origin,
        manifest.in_source->unit_dims}) {
    absl::StrAppend(&key, "\n", numbers.x, " ", numbers.y, " ", numbers.z);
  }
  for (const auto& [name, text] : manifest.in_source->request) {
    absl::StrAppend(&key, "\n", name, "\n", text.size(), "\n", text);
  }
  return key;
}

absl::StatusOr<std::shared_ptr<const OpenSource>> Sources::Open(const store::Manifest& manifest) {
  const std::string key = KeyOfSource(manifest);
  ISOSCOPE_RETURN_IF_ERROR(turn_.Take());
  const TurnEnd turn_end(&turn_);
  turn_.AssertHeld();
  std::shared_ptr<const OpenSource> source = Find(key);
  return source != nullptr ? source : OpenAs(key, manifest);
}

absl::StatusOr<std::shared_ptr<const OpenSource>> Sources::OpenAgain(
    const store::Manifest& manifest, std::int64_t number) {
  const std::string key = KeyOfSource(manifest);
  ISOSCOPE_RETURN_IF_ERROR(turn_.Take());
  const TurnEnd turn_end(&turn_);
  turn_.AssertHeld();
  if (std::shared_ptr<const OpenSource> source = Find(key);
      source != nullptr && source->number != number) {
    return source;
  }
  const std::string path = PathOf(manifest.in_source->request.at("path"));
  if (IsAddress(path)) {
    source::ForgetAddress(path);
  }
  series_.clear();  // they keep what they have read of a header
  return OpenAs(key, manifest);
}

std::shared_ptr<const OpenSource> Sources::Find(const std::string& key) const {
  const auto found = open_.find(key);
  return found == open_.end() ? nullptr : found->second.lock();
}

absl::StatusOr<std::shared_ptr<const OpenSource>> Sources::OpenAs(const std::string& key,
                                                                  const store::Manifest& manifest) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const OpenSource> source, OpenNow(manifest));
  // A series has many volumes, of which few are open.
  std::erase_if(open_, [](const auto& entry) { return entry.second.expired(); });
  open_[key] = source;
  return source;
}

std::string Sources::PathOf(const std::string& recorded) const {
  for (const auto& [from, to] : access_.allowed) {
    if (from != to && IsBelow(recorded, from)) {
      const absl::string_view rest =
          absl::string_view(recorded).substr(absl::StripSuffix(from, "/").size());
      return absl::StrCat(absl::StripSuffix(to, "/"), rest);
    }
  }
  return recorded;
}

absl::Status Sources::CheckAllowed(const std::string& path, absl::string_view where) const {
  std::string resolved = path;
  if (!IsAddress(path)) {
    if (access_.allows_local_files) {
      return absl::OkStatus();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(resolved, source::ResolvedPath(path));
  }
  for (const AllowedSource& allowed : access_.allowed) {
    std::string prefix = allowed.actual;
    if (IsAddress(prefix) != IsAddress(path)) {
      continue;
    }
    if (!IsAddress(prefix)) {
      ISOSCOPE_ASSIGN_OR_RETURN(prefix, source::ResolvedPath(prefix));
    }
    if (IsBelow(resolved, prefix) && !absl::StrContains(resolved, "/..")) {
      return absl::OkStatus();
    }
  }
  return Unreadable(absl::PermissionDeniedError(
      absl::StrCat(where, ": its samples are in ", path,
                   IsAddress(path) ? "" : absl::StrCat(" (", resolved, ")"),
                   ", which this program may not read: if you trust the dataset, allow it with "
                   "ISOSCOPE_ALLOW_SOURCE=",
                   path, " (of isoscope-agent also --allow-source)")));
}

absl::StatusOr<std::shared_ptr<const OpenSource>> Sources::OpenNow(
    const store::Manifest& manifest) {
  const std::string where = absl::StrCat("index-only dataset ", manifest.name);
  ISOSCOPE_ASSIGN_OR_RETURN(source::OpenRequest request,
                            DecodeSourceRequest(manifest.in_source->request, where));
  const SourceNames names{
      .dataset = manifest.name, .recorded = request.path, .actual = PathOf(request.path)};
  request.path = names.actual;
  ISOSCOPE_RETURN_IF_ERROR(CheckAllowed(request.path, where));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<SourceVolume> wanted,
                            DecodeSourceVolume(manifest.in_source->request, where));
  absl::StatusOr<OpenVolume> opened =
      wanted.has_value() ? OpenOneOf(request, manifest.in_source->request, *wanted, where)
                         : OpenOnly(request, where);
  if (!opened.ok()) {
    const bool is_ours = absl::StartsWith(opened.status().message(), where);  // CheckAllowed
    return is_ours ? opened.status() : Explain(names, opened.status());
  }
  std::unique_ptr<source::VolumeSource> volume = std::move(opened->volume);
  const source::SourceInfo& info = volume->info();
  const math::Index3& dims = info.geometry.sample_dims;
  const math::Index3& expected = manifest.geometry.sample_dims;
  if (!(dims == expected) || info.type != manifest.scalar_type || !volume->box_grid().has_value()) {
    return Explain(
        names,
        absl::InvalidArgumentError(absl::StrFormat(
            "%s: %d x %d x %d samples of %s, expected %d x %d x %d of %s that can be read in any "
            "order",
            request.path, dims.x, dims.y, dims.z, volume::NameOf(info.type), expected.x, expected.y,
            expected.z, volume::NameOf(manifest.scalar_type))));
  }
  // With the samples that a stride skips.
  const auto stride = static_cast<double>(request.stride);
  const double factor = static_cast<double>(volume->decoding_factor()) * stride * stride * stride;
  return std::make_shared<const OpenSource>(
      OpenSource{.names = names,
                 .number = next_number_++,
                 .is_local = !IsAddress(request.path),
                 .decoding_factor = factor,
                 .request = std::move(request),
                 .step = wanted.has_value() ? wanted->step : 0,
                 .step_count = opened->step_count,
                 .volume = std::move(volume)});
}

absl::StatusOr<OpenVolume> Sources::OpenOnly(const source::OpenRequest& request,
                                             absl::string_view where) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<source::VolumeSeries> series,
                            OpenSeries(request, where));
  if (!source::IsOneVolume(series->info())) {
    return absl::InvalidArgumentError(
        absl::StrCat(request.path, ": has several fields or steps, expected one"));
  }
  OpenVolume opened;
  ISOSCOPE_ASSIGN_OR_RETURN(opened.volume, series->Open(0, 0, 0));
  return opened;
}

absl::StatusOr<OpenVolume> Sources::OpenOneOf(const source::OpenRequest& request,
                                              std::map<std::string, std::string> members,
                                              const SourceVolume& wanted, absl::string_view where) {
  for (const char* const member :
       {store::kFieldMember, store::kComponentMember, store::kStepMember}) {
    members.erase(member);
  }
  auto kept = std::find_if(series_.begin(), series_.end(),
                           [&](const auto& entry) { return entry.first == members; });
  if (kept == series_.end()) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<source::VolumeSeries> opened,
                              OpenSeries(request, where));
    kept = series_.emplace(series_.end(), std::move(members), std::move(opened));
  }
  series_.splice(series_.begin(), series_, kept);
  if (series_.size() > kKeptSeries) {
    series_.pop_back();
  }
  source::VolumeSeries& series = *kept->second;
  absl::StatusOr<std::unique_ptr<source::VolumeSource>> volume = OpenFrom(request, series, wanted);
  if (!volume.ok()) {
    series_.erase(kept);  // it may be another one by now
    return volume.status();
  }
  return OpenVolume{.volume = *std::move(volume), .step_count = series.info().step_count()};
}

absl::StatusOr<std::shared_ptr<source::VolumeSeries>> Sources::OpenSeries(
    const source::OpenRequest& request, absl::string_view where) const {
  const source::AddressOpening opening;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> files, source::FilesOf(request));
  for (const std::string& file : files) {
    ISOSCOPE_RETURN_IF_ERROR(CheckAllowed(file, where));
  }
  return source::Open(request);
}

class UnitReader final : public store::SampleReader {
 public:
  UnitReader(std::shared_ptr<Sources> sources, const std::shared_ptr<const OpenSource>& source,
             const volume::BlockLayout& layout, const store::Manifest& manifest)
      : sources_(std::move(sources)),
        manifest_(manifest),
        layout_(layout),
        samples_(*manifest.in_source),
        type_(manifest.scalar_type),
        origin_(samples_.unit_origin),
        unit_dims_(samples_.unit_dims),
        name_(source->names.actual),
        is_local_(source->is_local),
        source_(source) {
    for (int axis = 0; axis < 3; ++axis) {
      counts_[axis] = (layout_.sample_dims()[axis] - origin_[axis] - 1) / unit_dims_[axis] + 1;
    }
  }

  [[nodiscard]] absl::Status ReadBlock(volume::BlockId id, const base::Cancellation& cancellation,
                                       char* out) const override {
    const math::Index3 unit = UnitOf(id);
    ISOSCOPE_ASSIGN_OR_RETURN(const UnitSamples samples, SamplesOf(unit, cancellation));
    CopyFrom(BoxOf(unit), *samples, layout_.StoredSamplesOf(id), out);
    return absl::OkStatus();
  }
  [[nodiscard]] math::Index3 UnitOf(volume::BlockId id) const override {
    return store::UnitOfBlock(layout_, samples_, id);
  }
  [[nodiscard]] absl::Status ReadUnit(const math::Index3& unit,
                                      const base::Cancellation& cancellation) const override {
    return SamplesOf(unit, cancellation).status();
  }
  [[nodiscard]] absl::Status Doubt(volume::BlockId id) const override {
    const std::shared_ptr<const OpenSource> source = Source();
    sources_->units().Doubt(KeyOf(*source, UnitOf(id)));
    ISOSCOPE_RETURN_IF_ERROR(OpenAgain(*source, base::ProcessInterrupt()).status());
    const base::MutexLock lock(&mutex_);
    return gap_error_;
  }
  [[nodiscard]] bool HasUnit(const math::Index3& unit) const override {
    return sources_->units().Has(KeyOf(*Source(), unit));
  }
  // Half of what is kept at least: the rest is for what is in use, which must not be dropped for them.
  [[nodiscard]] std::size_t max_units_ahead() const override {
    const auto unit_bytes =
        static_cast<std::size_t>(math::Volume(unit_dims_)) * volume::SizeOf(type_);
    return sources_->units().least_kept_bytes() / 2 / unit_bytes;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] bool is_local() const override { return is_local_; }

 private:
  using UnitSamples = std::shared_ptr<const std::string>;

  [[nodiscard]] UnitCache::Key KeyOf(const OpenSource& source, const math::Index3& unit) const {
    return {source.number, unit.x + counts_.x * (unit.y + counts_.y * unit.z)};
  }

  // The source as it was opened last.
  [[nodiscard]] std::shared_ptr<const OpenSource> Source() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return source_;
  }
  // Opens a source once more that has given an error or other samples: it may have vanished, or be
  // back as it was. Returns the same one, or the same error, if that was tried just before. Threads
  // wait for the one that opens it. If its frame is cancelled, the next one opens it.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const OpenSource>> OpenAgain(
      const OpenSource& doubtful, const base::Cancellation& cancellation) const
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::ThreadInterrupt interrupt(cancellation);
    ISOSCOPE_RETURN_IF_ERROR(reopening_.Take());
    const TurnEnd turn_end(&reopening_);
    {
      const base::MutexLock lock(&mutex_);
      if (source_->number != doubtful.number) {
        return source_;
      }
      if (base::MonotonicNow() - reopened_ < kReopeningPause) {
        ISOSCOPE_RETURN_IF_ERROR(reopening_error_);
        return source_;
      }
    }
    // A task of this thread's arena could wait for the lock that it holds.
    absl::StatusOr<std::shared_ptr<const OpenSource>> source = tbb::this_task_arena::isolate(
        [&] { return sources_->OpenAgain(manifest_, doubtful.number); });
    if (!source.ok()) {
      ISOSCOPE_RETURN_IF_ERROR(base::ProcessInterrupt().Check());  // says nothing of the source
    }
    const absl::Status gap_error = source.ok() ? CheckSteps(**source) : absl::OkStatus();
    const base::MutexLock lock(&mutex_);
    reopened_ = base::MonotonicNow();
    reopening_error_ = source.status();
    gap_error_ = gap_error;
    source_ = source.ok() ? *source : source_;
    return source;
  }
  // The samples of a unit that lie in the volume.
  [[nodiscard]] math::IndexBox BoxOf(const math::Index3& unit) const {
    math::IndexBox box;
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t begin = origin_[axis] + unit[axis] * unit_dims_[axis];
      box.begin[axis] = std::max<std::int64_t>(begin, 0);
      box.end[axis] = std::min(begin + unit_dims_[axis], layout_.sample_dims()[axis]);
    }
    return box;
  }

  absl::StatusOr<UnitSamples> SamplesOf(const math::Index3& unit,
                                        const base::Cancellation& cancellation) const {
    const std::shared_ptr<const OpenSource> source = Source();
    absl::StatusOr<UnitSamples> samples = SamplesFrom(*source, unit, cancellation);
    if (!absl::IsDataLoss(samples.status())) {
      return samples;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const OpenSource> again,
                              OpenAgain(*source, cancellation));
    return again->number == source->number ? samples : SamplesFrom(*again, unit, cancellation);
  }
  [[nodiscard]] absl::StatusOr<UnitSamples> SamplesFrom(
      const OpenSource& source, const math::Index3& unit,
      const base::Cancellation& cancellation) const {
    const math::IndexBox box = BoxOf(unit);
    const auto size = static_cast<std::size_t>(math::Volume(box.dims())) * volume::SizeOf(type_);
    const double decoded = static_cast<double>(size) * source.decoding_factor;
    return sources_->units().Get(
        KeyOf(source, unit), size,
        static_cast<std::size_t>(std::min(decoded, static_cast<double>(kMostBytes))), cancellation,
        [&](char* bytes) { return ReadBox(source, box, bytes, cancellation); });
  }
  // The source may have vanished since it was opened, or be another one.
  [[nodiscard]] static absl::Status ReadBox(const OpenSource& source, const math::IndexBox& box,
                                            char* bytes, const base::Cancellation& cancellation) {
    absl::Status status = source.volume->ReadBox(box, bytes, cancellation);
    if (status.ok() || absl::IsCancelled(status) || absl::IsDeadlineExceeded(status) ||
        absl::IsResourceExhausted(status)) {
      return status;
    }
    return Explain(source.names, status);
  }

  // Copies what a unit has of a block's stored samples.
  void CopyFrom(const math::IndexBox& box, const std::string& samples, const math::IndexBox& stored,
                char* out) const {
    const auto sample_bytes = static_cast<std::int64_t>(volume::SizeOf(type_));
    math::IndexBox part;
    for (int axis = 0; axis < 3; ++axis) {
      part.begin[axis] = std::max(box.begin[axis], stored.begin[axis]);
      part.end[axis] = std::min(box.end[axis], stored.end[axis]);
    }
    const auto offset_in = [&](const math::IndexBox& whole, std::int64_t y, std::int64_t z) {
      const math::Index3 dims = whole.dims();
      return (((z - whole.begin.z) * dims.y + y - whole.begin.y) * dims.x + part.begin.x -
              whole.begin.x) *
             sample_bytes;
    };
    const auto row_bytes = static_cast<std::size_t>(part.dims().x * sample_bytes);
    for (std::int64_t z = part.begin.z; z < part.end.z; ++z) {
      for (std::int64_t y = part.begin.y; y < part.end.y; ++y) {
        std::memcpy(out + offset_in(stored, y, z), samples.data() + offset_in(box, y, z),
                    row_bytes);
      }
    }
  }

  const std::shared_ptr<Sources> sources_;
  const store::Manifest manifest_;
  const volume::BlockLayout layout_;
  const store::SourceSamples samples_;
  const volume::ScalarType type_;
  const math::Index3 origin_;
  const math::Index3 unit_dims_;
  const std::string name_;
  const bool is_local_;
  math::Index3 counts_;  // of units

  mutable Turn reopening_;  // taken while the source is opened again
  mutable base::Mutex mutex_;
  mutable std::shared_ptr<const OpenSource> source_ ABSL_GUARDED_BY(mutex_);
  // Of the last OpenAgain:
  mutable base::MonotonicTime reopened_ ABSL_GUARDED_BY(mutex_) =
      base::MonotonicTime::InfinitePast();
  mutable absl::Status reopening_error_ ABSL_GUARDED_BY(mutex_);
  mutable absl::Status gap_error_ ABSL_GUARDED_BY(mutex_);  // CheckSteps
};

}  // namespace

absl::StatusOr<AllowedSource> ParseAllowedSource(absl::string_view text) {
  const std::pair<absl::string_view, absl::string_view> sides =
      absl::StrSplit(text, absl::MaxSplits('=', 1));
  AllowedSource allowed{
      .recorded = std::string(sides.first),
      .actual = std::string(absl::StrContains(text, '=') ? sides.second : sides.first)};
  for (const std::string& side : {allowed.recorded, allowed.actual}) {
    if (!absl::StartsWith(side, "/") && !IsAddress(side)) {
      return absl::InvalidArgumentError(absl::StrCat(
          "'", text, "': expected an absolute path or an address, PREFIX or RECORDED=ACTUAL"));
    }
  }
  return allowed;
}

absl::StatusOr<SourceAccess> AccessOfUser() {
  SourceAccess access{.allows_local_files = true};
  if (const char* const text =
          std::getenv("ISOSCOPE_ALLOW_SOURCE");  // NOLINT(concurrency-mt-unsafe)
      text != nullptr && *text != '\0') {
    absl::StatusOr<AllowedSource> allowed = ParseAllowedSource(text);
    if (!allowed.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("ISOSCOPE_ALLOW_SOURCE: ", allowed.status().message()));
    }
    access.allowed.push_back(*std::move(allowed));
  }
  return access;
}

store::OpenSamples MakeSampleOpener(const SourceAccess& access) {
  source::BoundShardIndexes(access.max_index_bytes);
  return [sources = std::make_shared<Sources>(access)](const store::Manifest& manifest)
             -> absl::StatusOr<std::shared_ptr<const store::SampleReader>> {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::BlockLayout layout,
        volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const OpenSource> source, sources->Open(manifest));
    return std::make_shared<const UnitReader>(sources, source, layout, manifest);
  };
}

}  // namespace isoscope::indexed
