#include "core/source/remote/open_address.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/object_key.h"
#include "core/source/remote/address.h"
#include "core/source/remote/fetch.h"
#include "core/source/remote/range_plan.h"
#include "core/source/remote/remote_client.h"
#include "core/source/remote/transfer_engine.h"

namespace isoscope::source {
namespace {

// What opens an object. Not one: to bytes=0-0 some servers of S3 send all, as if it had no end.
constexpr std::int64_t kFewBytes = 2;

// Copies a piece to its ranges. It is begun once: of an exact range, what has come stays.
class PieceSink : public FetchSink {
 public:
  explicit PieceSink(const RangePiece& piece) : writer_(piece) {}

  absl::Status Begin(std::int64_t /*size*/) override { return absl::OkStatus(); }
  absl::Status Append(absl::string_view bytes) override {
    if (static_cast<std::int64_t>(bytes.size()) > writer_.left_bytes()) {
      return absl::DataLossError("the server sends more than it was asked for");
    }
    writer_.Append(bytes);
    return absl::OkStatus();
  }

 private:
  PieceWriter writer_;
};

// Keeps at most `max_size` bytes.
class StringSink : public FetchSink {
 public:
  explicit StringSink(std::int64_t max_size) : max_size_(max_size) {}

  absl::Status Begin(std::int64_t size) override {
    bytes_.clear();
    if (size > max_size_) {
      return TooLarge(size);
    }
    if (size > 0) {
      bytes_.reserve(static_cast<std::size_t>(size));
    }
    return absl::OkStatus();
  }
  absl::Status Append(absl::string_view bytes) override {
    const auto size = static_cast<std::int64_t>(bytes_.size() + bytes.size());
    if (size > max_size_) {
      return TooLarge(size);
    }
    bytes_.append(bytes.data(), bytes.size());
    return absl::OkStatus();
  }
  std::string Take() { return std::move(bytes_); }

 private:
  [[nodiscard]] absl::Status TooLarge(std::int64_t size) const {
    return absl::ResourceExhaustedError(
        absl::StrCat(size, " bytes or more; expected at most ", max_size_));
  }

  const std::int64_t max_size_;
  std::string bytes_;
};

class RemoteObject : public ByteSource {
 public:
  // start: gets the first `start_bytes`; null: nobody wants them
  static absl::StatusOr<std::unique_ptr<RemoteObject>> Open(
      const std::shared_ptr<RemoteClient>& client, const Address& address, std::int64_t start_bytes,
      std::string* start, const base::Cancellation& cancellation) {
    StringSink first_bytes(start_bytes);
    FetchJob job{.address = address,
                 .kind = FetchJob::Kind::kWithin,
                 .first = 0,
                 .last = start_bytes - 1,
                 .sink = &first_bytes};
    ISOSCOPE_RETURN_IF_ERROR(
        Fetch(client.get(), absl::MakeSpan(&job, 1), /*stops_at_error=*/true, cancellation));
    if (job.version.size < 0) {
      return absl::FailedPreconditionError(
          absl::StrCat(NameOf(address), ": the server does not tell the size of the object"));
    }
    if (start != nullptr) {
      *start = first_bytes.Take();
    }
    return std::make_unique<RemoteObject>(client, address, std::move(job.version),
                                          std::move(job.redirected));
  }

  RemoteObject(std::shared_ptr<RemoteClient> client, Address address, ObjectVersion version,
               std::optional<Address> redirected)
      : client_(std::move(client)),
        address_(std::move(address)),
        name_(NameOf(address_)),
        version_(std::move(version)),
        redirected_(std::move(redirected)) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    for (const ByteRange& range : ranges) {
      ISOSCOPE_RETURN_IF_ERROR(CheckWithin(range, version_.size, name_));
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    const std::vector<RangePiece> pieces = PlanRanges(ranges, client_->options().ranges);
    std::vector<PieceSink> sinks;
    sinks.reserve(pieces.size());
    std::vector<FetchJob> jobs;
    jobs.reserve(pieces.size());
    const std::optional<Address> redirected = Redirected();
    for (const RangePiece& piece : pieces) {
      sinks.emplace_back(piece);
      jobs.push_back({.address = address_,
                      .redirected = redirected,
                      .kind = FetchJob::Kind::kExact,
                      .first = piece.begin,
                      .last = piece.end - 1,
                      .expected = &version_,
                      .sink = &sinks.back()});
    }
    ISOSCOPE_RETURN_IF_ERROR(
        Fetch(client_.get(), absl::MakeSpan(jobs), /*stops_at_error=*/true, cancellation));
    if (!jobs.empty()) {
      const base::MutexLock lock(&mutex_);
      redirected_ = jobs.back().redirected;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return version_.size; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string version() const override {
    if (!version_.etag.empty() || version_.last_modified.empty()) {
      return version_.etag;
    }
    return absl::StrCat(version_.size, "-", version_.last_modified);
  }

 private:
  [[nodiscard]] std::optional<Address> Redirected() const {
    const base::MutexLock lock(&mutex_);
    return redirected_;
  }

  const std::shared_ptr<RemoteClient> client_;
  const Address address_;
  const std::string name_;
  const ObjectVersion version_;
  mutable base::Mutex mutex_;
  mutable std::optional<Address> redirected_ ABSL_GUARDED_BY(mutex_);
};

class RemoteStore : public ObjectStore {
 public:
  RemoteStore(std::shared_ptr<RemoteClient> client, Address prefix)
      : client_(std::move(client)), prefix_(std::move(prefix)), name_(NameOf(prefix_)) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> answers(reads.size());
    std::vector<StringSink> sinks;
    sinks.reserve(reads.size());
    std::vector<FetchJob> jobs;
    std::vector<std::size_t> read_of_job;
    for (std::size_t i = 0; i < reads.size(); ++i) {
      sinks.emplace_back(reads[i].max_size);
      const absl::Status key = CheckRead(reads[i]);
      if (!key.ok()) {
        answers[i] = key;
        continue;
      }
      if (IsIndirect(reads[i])) {
        answers[i] = ReadIndirectly(reads[i], cancellation);
        continue;
      }
      jobs.push_back(JobOf(reads[i]));
      jobs.back().sink = &sinks.back();
      read_of_job.push_back(i);
    }
    Fetch(client_.get(), absl::MakeSpan(jobs), /*stops_at_error=*/false, cancellation)
        .IgnoreError();  // each job has its own
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      const std::size_t i = read_of_job[j];
      if (IsSuffixMistaken(jobs[j])) {
        answers[i] = ReadIndirectly(reads[i], cancellation);
        knows_suffixes_ = knows_suffixes_ && !answers[i].ok();
      } else {
        answers[i] = AnswerOf(reads[i], jobs[j], &sinks[i]);
      }
    }
    return answers;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override {
    ISOSCOPE_RETURN_IF_ERROR(CheckObjectKey(key));
    return RemoteObject::Open(client_, AddressBelow(prefix_, key), kFewBytes, nullptr,
                              cancellation);
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  [[nodiscard]] absl::Status CheckRead(const ObjectRead& read) const {
    ISOSCOPE_RETURN_IF_ERROR(CheckObjectKey(read.key));
    if (read.size > read.max_size) {
      return absl::ResourceExhaustedError(
          absl::StrCat(NameOf(AddressBelow(prefix_, read.key)), ": ", read.size,
                       " bytes are wanted; expected at most ", read.max_size));
    }
    return absl::OkStatus();
  }

  // Reads that one request can't express: of no bytes, of the first bytes of a suffix, of a suffix
  // where the server knows none.
  [[nodiscard]] bool IsIndirect(const ObjectRead& read) const {
    return read.size == 0 ||
           (read.offset < 0 && (!knows_suffixes_ || (read.size >= 0 && read.size != -read.offset)));
  }
  // Some servers know ranges, but not bytes=-N: they send the whole object, or its first bytes.
  static bool IsSuffixMistaken(const FetchJob& job) {
    return job.kind == FetchJob::Kind::kSuffix &&
           (absl::IsFailedPrecondition(job.status) || absl::IsDataLoss(job.status) ||
            absl::IsOutOfRange(job.status));
  }

  [[nodiscard]] absl::StatusOr<std::string> ReadIndirectly(
      const ObjectRead& read, const base::Cancellation& cancellation) const {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> object,
                              Open(read.key, cancellation));
    ISOSCOPE_ASSIGN_OR_RETURN(const ObjectExtent extent,
                              ExtentOf(read, object->size_bytes(), object->name()));
    std::string bytes(static_cast<std::size_t>(extent.size), '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        object->ReadAt(extent.offset, bytes.size(), bytes.data(), cancellation));
    return bytes;
  }

  [[nodiscard]] FetchJob JobOf(const ObjectRead& read) const {
    FetchJob job{.address = AddressBelow(prefix_, read.key)};
    if (read.offset < 0) {
      job.kind = FetchJob::Kind::kSuffix;
      job.last = -read.offset;
    } else if (read.offset > 0 || read.size >= 0) {
      job.kind = FetchJob::Kind::kWithin;
      job.first = read.offset;
      job.last = read.size < 0 ? -1 : read.offset + (read.size - 1);
    }
    return job;
  }

  static absl::StatusOr<std::string> AnswerOf(const ObjectRead& read, const FetchJob& job,
                                              StringSink* sink) {
    ISOSCOPE_RETURN_IF_ERROR(job.status);
    std::string bytes = sink->Take();
    if (job.kind == FetchJob::Kind::kWhole) {
      return bytes;
    }
    if (job.version.size >= 0) {
      ISOSCOPE_RETURN_IF_ERROR(ExtentOf(read, job.version.size, NameOf(job.address)).status());
    }
    if (read.size >= 0 && static_cast<std::int64_t>(bytes.size()) != read.size) {
      return absl::OutOfRangeError(absl::StrCat(NameOf(job.address), ": ", bytes.size(),
                                                " bytes at offset ", read.offset, ", expected ",
                                                read.size));
    }
    return bytes;
  }

  const std::shared_ptr<RemoteClient> client_;
  const Address prefix_;
  const std::string name_;
  mutable std::atomic<bool> knows_suffixes_ = true;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ByteSource>> OpenAddress(absl::string_view address,
                                                        const RemoteOptions& options,
                                                        const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(StartedObject opened,
                            OpenAddressWithStart(address, options, kFewBytes, cancellation));
  return std::move(opened.bytes);
}

absl::StatusOr<StartedObject> OpenAddressWithStart(absl::string_view address,
                                                   const RemoteOptions& options,
                                                   std::int64_t start_bytes,
                                                   const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Address parsed, ParseAddress(address));
  if (parsed.is_s3 && parsed.key.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(NameOf(parsed), ": names a bucket; expected s3://BUCKET/KEY"));
  }
  const auto client = std::make_shared<RemoteClient>(options, TransferEngine::OfProcess());
  StartedObject opened;
  auto object = RemoteObject::Open(client, parsed, start_bytes, &opened.start, cancellation);
  if (absl::IsFailedPrecondition(object.status()) && start_bytes > kFewBytes) {
    // Some servers answer 200 to a range that has the whole object, and know others.
    opened.start.clear();
    object = RemoteObject::Open(client, parsed, kFewBytes, nullptr, cancellation);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(opened.bytes, std::move(object));
  return opened;
}

absl::StatusOr<std::unique_ptr<ObjectStore>> OpenAddressStore(absl::string_view prefix,
                                                              const RemoteOptions& options) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Address parsed, ParseAddress(prefix));
  return std::make_unique<RemoteStore>(
      std::make_shared<RemoteClient>(options, TransferEngine::OfProcess()), parsed);
}

}  // namespace isoscope::source
