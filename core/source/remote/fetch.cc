// One job is a state machine. A Fetching holds it; the engine's thread writes to it while its
// transfer runs, the caller's thread between transfers.
//
//   state        event                                 next
//   ready        a place in the window                 running
//   running      complete, all bytes                   done
//                redirect, learned region, 412 once    ready
//                broken, or a status to retry          waiting, or done after max_attempts
//                anything else                         done
//   waiting      its time has come                     ready
//   any          the cancellation fires                done
//
// Steps of an answer: OnHead checks it (CheckAnswer) before a byte of the body is taken; OnBytes
// counts; TakeResult decides what is next.

#include "core/source/remote/fetch.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <memory>
#include <random>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/random.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/remote/retry_policy.h"
#include "core/source/remote/transfer_engine.h"

namespace isoscope::source {
namespace {

using Outcome = TransferResult::Outcome;
using Credentials = PreparedRequest::Credentials;

constexpr int kMaxRedirects = 5;
// Of the body of an error: kept, and read so that the connection can be used again.
constexpr std::size_t kMaxErrorBytes = 4 * static_cast<std::size_t>(base::kKiB);
constexpr std::int64_t kMaxDrainedBytes = 64 * base::kKiB;

double RandomFraction() {
  static const std::uint64_t seed = std::random_device()();
  static std::atomic<std::uint64_t> counter{0};
  return base::RandomUnit(seed, counter.fetch_add(1));
}

bool IsRedirect(int status) {
  return status == 301 || status == 302 || status == 303 || status == 307 || status == 308;
}

bool IsWeak(absl::string_view etag) { return absl::StartsWith(etag, "W/"); }

// An ETag for people: "abc" of "\"abc\"".
std::string EtagText(absl::string_view etag) {
  const bool has_marks = etag.size() >= 2 && etag.front() == '"' && etag.back() == '"';
  return base::Quoted(has_marks ? etag.substr(1, etag.size() - 2) : etag);
}

// The text of <Code> in an error of S3: a word, or nothing.
std::string XmlWord(absl::string_view xml, absl::string_view element) {
  const std::string begin = absl::StrCat("<", element, ">");
  const std::size_t at = xml.find(begin);
  if (at == absl::string_view::npos) {
    return "";
  }
  const absl::string_view rest = xml.substr(at + begin.size());
  const absl::string_view word = rest.substr(0, rest.find('<'));
  const bool is_word = word.size() <= 64 && std::all_of(word.begin(), word.end(), [](char c) {
                         return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-';
                       });
  return is_word ? std::string(word) : "";
}

// gzip as the coding of a file that is called .gz is the file itself, as old servers announce it.
bool IsStoredCoding(absl::string_view coding, const Address& address) {
  const std::string lower = absl::AsciiStrToLower(coding);
  if (lower.empty() || lower == "identity") {
    return true;
  }
  const std::string path = absl::AsciiStrToLower(address.is_s3 ? address.key : address.path);
  return (lower == "gzip" || lower == "x-gzip") &&
         (absl::EndsWith(path, "gz") || absl::EndsWith(path, ".tgz"));
}

// A job, and its transfer if it has one.
class Fetching : public TransferSink {
 public:
  void Init(RemoteClient* client, FetchJob* job) {
    client_ = client;
    job_ = job;
    is_stale_redirect_ = job->redirected.has_value();
    current_ = job->redirected.value_or(job->address);
    allows_credentials_ = !is_stale_redirect_;
  }

  enum class Next { kDone, kNow, kLater };

  // Begins the next attempt. An error is the job's result.
  absl::StatusOr<TransferRequest> Prepare() {
    head_ = {};
    is_body_ = false;
    is_drained_ = false;
    body_size_ = -1;
    body_bytes_ = 0;
    error_body_.clear();
    RequestSpec spec{.address = current_,
                     .query = job_->query,
                     .range = RangeHeader(),
                     .if_match = IfMatch(),
                     .allows_credentials = allows_credentials_};
    auto prepared = client_->Prepare(spec);
    if (!prepared.ok()) {
      return absl::Status(prepared.status().code(),
                          absl::StrCat(Name(), ": ", prepared.status().message()));
    }
    url_ = prepared->url;
    credentials_ = prepared->credentials;
    return std::move(prepared->transfer);
  }

  absl::Status OnHead(const ResponseHead& head) override {
    head_ = head;
    is_body_ = head.status / 100 == 2;
    if (!is_body_) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckAnswer());
    if (received_bytes_ == 0 && body_size_ != 0) {
      return job_->sink->Begin(body_size_);
    }
    return absl::OkStatus();
  }

  absl::Status OnBytes(absl::string_view bytes) override {
    const auto size = static_cast<std::int64_t>(bytes.size());
    body_bytes_ += size;
    if (!is_body_) {
      absl::StrAppend(&error_body_, bytes.substr(0, kMaxErrorBytes - std::min(kMaxErrorBytes,
                                                                              error_body_.size())));
      is_drained_ = body_bytes_ > kMaxDrainedBytes;
      return is_drained_ ? absl::CancelledError("the error is long") : absl::OkStatus();
    }
    if (body_size_ >= 0 && body_bytes_ > body_size_) {
      return absl::DataLossError(
          absl::StrCat("the server sends more than the ", body_size_, " bytes it was asked for"));
    }
    ISOSCOPE_RETURN_IF_ERROR(job_->sink->Append(bytes));
    if (job_->kind == FetchJob::Kind::kExact) {
      received_bytes_ += size;
    }
    return absl::OkStatus();
  }

  // Decides what follows a transfer. kDone: the job has its status. kLater: at not_before().
  Next TakeResult(const TransferResult& result) {
    const bool has_error_status = head_.status >= 300;
    if (has_error_status && (result.outcome == Outcome::kComplete || is_drained_ ||
                             result.outcome == Outcome::kBroken)) {
      return TakeStatus();
    }
    switch (result.outcome) {
      case Outcome::kComplete:
        return IsShort() ? Retry(absl::StrCat("the body ended after ", body_bytes_, " of ",
                                              body_size_, " bytes"),
                                 std::nullopt)
                         : Succeed();
      case Outcome::kBroken:
        return job_->kind == FetchJob::Kind::kExact && received_bytes_ == WantedBytes()
                   ? Succeed()
                   : Retry(result.status.message(), std::nullopt);
      case Outcome::kStopped:
      case Outcome::kFailed:
        break;
    }
    return Fail(result.status.code(), result.status.message());
  }

  [[nodiscard]] base::MonotonicTime not_before() const { return not_before_; }

 private:
  [[nodiscard]] std::string Name() const {
    std::string name = NameOf(job_->address);
    switch (job_->kind) {
      case FetchJob::Kind::kWhole:
        break;
      case FetchJob::Kind::kSuffix:
        absl::StrAppend(&name, ": last ", job_->last, " bytes");
        break;
      case FetchJob::Kind::kExact:
      case FetchJob::Kind::kWithin:
        if (job_->kind == FetchJob::Kind::kWithin && job_->first == 0 && job_->last == 1) {
          break;  // the first bytes, which open the object
        }
        absl::StrAppend(&name, ": bytes from ", job_->first);
        if (job_->last >= 0) {
          absl::StrAppend(&name, " to ", job_->last);
        }
    }
    return name;
  }

  // Of kExact.
  [[nodiscard]] std::int64_t WantedBytes() const { return job_->last - job_->first + 1; }

  [[nodiscard]] std::string RangeHeader() const {
    switch (job_->kind) {
      case FetchJob::Kind::kWhole:
        return "";
      case FetchJob::Kind::kSuffix:
        return absl::StrCat("bytes=-", job_->last);
      case FetchJob::Kind::kExact:
        return absl::StrCat("bytes=", job_->first + received_bytes_, "-", job_->last);
      case FetchJob::Kind::kWithin:
        break;
    }
    return job_->last < 0 ? absl::StrCat("bytes=", job_->first, "-")
                          : absl::StrCat("bytes=", job_->first, "-", job_->last);
  }

  // A weak ETag never matches (RFC 9110, section 13.1.1).
  [[nodiscard]] std::string IfMatch() const {
    const bool is_usable = job_->expected != nullptr && !omits_if_match_ &&
                           !job_->expected->etag.empty() && !IsWeak(job_->expected->etag);
    return is_usable ? job_->expected->etag : "";
  }

  // Whether the answer's bytes are those that were asked for. Sets body_size_ and job_->version.
  absl::Status CheckAnswer() {
    if (!IsStoredCoding(head_.Header("content-encoding"), job_->address)) {
      return absl::FailedPreconditionError(
          absl::StrCat("the server sends the object in the coding ",
                       base::Quoted(head_.Header("content-encoding")), "; expected its own bytes"));
    }
    std::int64_t content_length = -1;
    if (!absl::SimpleAtoi(head_.Header("content-length"), &content_length)) {
      content_length = -1;
    }
    ObjectVersion& seen = job_->version;
    seen = {.etag = head_.Header("etag"), .last_modified = head_.Header("last-modified")};
    if (job_->kind == FetchJob::Kind::kWhole) {
      if (head_.status != 200) {
        return UnexpectedStatus();
      }
      body_size_ = content_length;
      seen.size = content_length;
      return CheckVersion();
    }
    if (head_.status == 200) {
      if (job_->kind == FetchJob::Kind::kWithin && job_->first == 0 && content_length == 0) {
        body_size_ = 0;  // an empty object, of which some servers send all
        seen.size = 0;
        return CheckVersion();
      }
      seen.size = content_length;
      job_->ignores_ranges = true;
      return absl::FailedPreconditionError(
          "the server ignores ranges: it answers 200 with the whole object; bring it with: "
          "isoscope "
          "copy ADDRESS; or use a server with ranges");
    }
    if (head_.status != 206) {
      return UnexpectedStatus();
    }
    const auto range = ParseContentRange(head_.Header("content-range"));
    if (!range || range->first < 0 || !IsWantedRange(*range)) {
      return absl::DataLossError(absl::StrCat("the server answers ", RangeHeader(),
                                              " with Content-Range ",
                                              base::Quoted(head_.Header("content-range"))));
    }
    body_size_ = range->last - range->first + 1;
    seen.size = range->total;
    if (content_length >= 0 && content_length != body_size_) {
      return absl::DataLossError(absl::StrCat("the server announces ", content_length,
                                              " bytes for a range of ", body_size_));
    }
    return CheckVersion();
  }

  absl::Status UnexpectedStatus() const {
    return absl::FailedPreconditionError(
        absl::StrCat("the server answers ", head_.status, "; expected ",
                     job_->kind == FetchJob::Kind::kWhole ? 200 : 206));
  }

  [[nodiscard]] bool IsWantedRange(const ContentRange& range) const {
    switch (job_->kind) {
      case FetchJob::Kind::kExact:
        return range.first == job_->first + received_bytes_ && range.last == job_->last;
      case FetchJob::Kind::kSuffix:
        return range.total >= 0 && range.last == range.total - 1 &&
               range.first == std::max<std::int64_t>(0, range.total - job_->last);
      case FetchJob::Kind::kWithin:
        // It ends where it was asked to, or the object does.
        return range.first == job_->first &&
               (range.last == job_->last || (range.total >= 0 && range.last == range.total - 1 &&
                                             (job_->last < 0 || range.last < job_->last)));
      case FetchJob::Kind::kWhole:
        break;
    }
    return false;
  }

  // Only what both answers say can differ.
  absl::Status CheckVersion() const {
    if (job_->expected == nullptr) {
      return absl::OkStatus();
    }
    const ObjectVersion& expected = *job_->expected;
    const ObjectVersion& seen = job_->version;
    if (expected.size >= 0 && seen.size >= 0 && expected.size != seen.size) {
      return Changed(absl::StrCat("it had ", expected.size, " bytes, and has ", seen.size));
    }
    if (!expected.etag.empty() && !seen.etag.empty() && expected.etag != seen.etag) {
      return Changed(
          absl::StrCat("its ETag was ", EtagText(expected.etag), ", and is ", EtagText(seen.etag)));
    }
    if (expected.etag.empty() && !expected.last_modified.empty() && !seen.last_modified.empty() &&
        expected.last_modified != seen.last_modified) {
      return Changed(absl::StrCat("it was last modified at ", base::Quoted(expected.last_modified),
                                  ", and now at ", base::Quoted(seen.last_modified)));
    }
    return absl::OkStatus();
  }

  static absl::Status Changed(absl::string_view how) {
    return absl::DataLossError(
        absl::StrCat("the object has changed since it was opened: ", how, "; open it again"));
  }

  [[nodiscard]] bool IsShort() const { return body_size_ >= 0 && body_bytes_ < body_size_; }

  // An answer with another status than 2xx.
  Next TakeStatus() {
    const int status = head_.status;
    if (job_->address.is_s3 && !has_learned_region_) {
      std::string region = head_.Header("x-amz-bucket-region");
      region = region.empty() ? XmlWord(error_body_, "Region") : region;
      if (client_->LearnRegion(job_->address.bucket, region)) {
        has_learned_region_ = true;
        return StartOver();
      }
    }
    if (IsRedirect(status)) {
      return Redirect();
    }
    if (IsRetryableStatus(status)) {
      return Retry(absl::StrCat("the server answers ", status, ErrorCode()),
                   ParseRetryAfter(head_.Header("retry-after"), head_.Header("date")));
    }
    if (is_stale_redirect_ && status < 411) {
      return StartOver();  // what an earlier redirect led to was for a time
    }
    const auto range = ParseContentRange(head_.Header("content-range"));
    switch (status) {
      case 401:
        return Fail(absl::StatusCode::kUnauthenticated,
                    absl::StrCat("the server answers 401", ErrorCode(), CredentialsHint()));
      case 403:
        return Fail(absl::StatusCode::kPermissionDenied,
                    absl::StrCat("the server answers 403", ErrorCode(), CredentialsHint(),
                                 job_->address.is_s3
                                     ? "; S3 answers so for missing objects, too, where the bucket "
                                       "may not be listed"
                                     : ""));
      case 404:
      case 410:
        return Fail(absl::StatusCode::kNotFound,
                    absl::StrCat(job_->expected == nullptr
                                     ? "there is no such object: the server answers "
                                     : "the object has vanished since it was opened: the server "
                                       "answers ",
                                 status, ErrorCode(), "; compare the address"));
      case 412:
        if (!omits_if_match_ && job_->expected != nullptr &&
            job_->expected->etag == head_.Header("etag")) {
          omits_if_match_ = true;  // a server that takes If-Match wrongly; we compare ourselves
          return Next::kNow;
        }
        return FinishWith(Changed("the server answers 412"));
      case 416:
        return TakeUnsatisfiable(range && range->first < 0 ? range->total : -1);
      default:
        return Fail(absl::StatusCode::kFailedPrecondition,
                    absl::StrCat("the server answers ", status, ErrorCode()));
    }
  }

  // 416: the range begins behind the object's end, which `total` tells, unless it is -1.
  Next TakeUnsatisfiable(std::int64_t total) {
    const bool is_exact = job_->kind == FetchJob::Kind::kExact;
    if (is_exact && total >= 0 && job_->expected != nullptr && total != job_->expected->size) {
      return FinishWith(
          Changed(absl::StrCat("it had ", job_->expected->size, " bytes, and has ", total)));
    }
    const bool is_end =
        job_->kind == FetchJob::Kind::kWithin ? total >= 0 && job_->first >= total : total == 0;
    if (!is_exact && is_end) {
      job_->version = {.etag = head_.Header("etag"),
                       .last_modified = head_.Header("last-modified"),
                       .size = total};
      job_->status = absl::OkStatus();
      return Next::kDone;
    }
    return Fail(absl::StatusCode::kOutOfRange, "the server answers 416: there are no such bytes");
  }

  Next Redirect() {
    const std::string location = head_.Header("location");
    if (location.empty()) {
      return Fail(absl::StatusCode::kFailedPrecondition,
                  absl::StrCat("the server answers ", head_.status, ErrorCode(),
                               " without a place to go to",
                               job_->address.is_s3 ? "; AWS_REGION may be another region" : ""));
    }
    if (++redirect_count_ > kMaxRedirects) {
      return Fail(absl::StatusCode::kFailedPrecondition,
                  absl::StrCat("the server redirects more than ", kMaxRedirects, " times"));
    }
    const auto next = ResolveLocation(url_, location);
    if (!next.ok() || next->is_s3) {
      return Fail(absl::StatusCode::kFailedPrecondition,
                  absl::StrCat("the server redirects to ",
                               base::Quoted(base::CutText(RedactAddress(location))),
                               ", which is not followed; expected an address of http or https"));
    }
    const std::string origin = OriginOf(*next);
    if (url_.is_https && !next->is_https) {
      return Fail(absl::StatusCode::kPermissionDenied,
                  absl::StrCat("the server redirects to ", origin,
                               ", which is not encrypted; only https is followed from https"));
    }
    const bool is_other_host = origin != OriginOf(url_);
    if (credentials_ == Credentials::kSignature || (is_other_host && HasCredentials())) {
      return Fail(absl::StatusCode::kPermissionDenied,
                  absl::StrCat("the server redirects to ", origin,
                               ", where credentials are not sent; give that address, or set "
                               "AWS_REGION or AWS_ENDPOINT_URL of S3"));
    }
    if (is_other_host && !client_->options().follows_to_other_hosts) {
      return Fail(absl::StatusCode::kPermissionDenied,
                  absl::StrCat("the server redirects to ", origin, ", another host"));
    }
    allows_credentials_ = allows_credentials_ && !is_other_host;
    current_ = *next;
    return Next::kNow;
  }

  [[nodiscard]] bool HasCredentials() const { return credentials_ != Credentials::kNone; }

  // From the job's own address, with its own credentials.
  void ReturnToOwnAddress() {
    is_stale_redirect_ = false;
    allows_credentials_ = true;
    redirect_count_ = 0;
    current_ = job_->address;
  }
  Next StartOver() {
    ReturnToOwnAddress();
    return Next::kNow;
  }

  Next Retry(absl::string_view reason, std::optional<absl::Duration> retry_after) {
    const RetryRules& rules = client_->options().retry;
    ++failures_;
    absl::Status status;
    if (retry_after && *retry_after > rules.max_retry_after) {
      status = absl::UnavailableError(absl::StrCat(
          Name(), ": ", reason, " and asks to wait ", absl::FormatDuration(*retry_after),
          ", more than ", absl::FormatDuration(rules.max_retry_after)));
    } else if (failures_ >= rules.max_attempts) {
      status = absl::UnavailableError(absl::StrCat(
          Name(), ": ", reason, ", at the last of ", failures_, " attempts; try again later",
          head_.status > 0 ? "" : ", or compare address, network and proxy"));
    }
    if (!status.ok()) {
      return FinishWith(
          retry_after ? base::WithRetryDelay(std::move(status), *retry_after) : std::move(status),
          /*is_named=*/true);
    }
    not_before_ = base::MonotonicNow() + std::max(RetryDelay(rules, failures_, RandomFraction()),
                                                  retry_after.value_or(absl::ZeroDuration()));
    ReturnToOwnAddress();
    return Next::kLater;
  }

  Next Succeed() {
    if (!current_.is_s3 && !(current_ == job_->address)) {
      job_->redirected = current_;
    } else {
      job_->redirected.reset();
    }
    job_->status = absl::OkStatus();
    return Next::kDone;
  }

  Next Fail(absl::StatusCode code, absl::string_view message) {
    return FinishWith(absl::Status(code, message));
  }
  Next FinishWith(absl::Status status, bool is_named = false) {
    job_->status = is_named
                       ? std::move(status)
                       : absl::Status(status.code(), absl::StrCat(Name(), ": ", status.message()));
    return Next::kDone;
  }

  // " (AccessDenied)", of S3 only: other bodies may repeat what was sent.
  [[nodiscard]] std::string ErrorCode() const {
    const std::string code = job_->address.is_s3 ? XmlWord(error_body_, "Code") : "";
    return code.empty() ? "" : absl::StrCat(" (", code, ")");
  }

  [[nodiscard]] std::string CredentialsHint() const {
    switch (credentials_) {
      case Credentials::kNone:
        return job_->address.is_s3
                   ? "; the request had no credentials: set AWS_ACCESS_KEY_ID and "
                     "AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
                   : "; the request had no credentials: set ISOSCOPE_BEARER_TOKEN and "
                     "ISOSCOPE_BEARER_TOKEN_ORIGIN, or write the host to ~/.netrc";
      case Credentials::kSignature:
        return "; the request was signed with AWS credentials: others may be needed";
      case Credentials::kToken:
        return "; the request had the token of ISOSCOPE_BEARER_TOKEN: another may be needed";
      case Credentials::kPassword:
        return "; the request had the password of the netrc file: another may be needed";
    }
    return "";
  }

  RemoteClient* client_ = nullptr;
  FetchJob* job_ = nullptr;

  // From attempt to attempt:
  Address current_;  // asked next
  bool allows_credentials_ = true;
  bool is_stale_redirect_ = false;  // current_ is of an earlier redirect
  bool omits_if_match_ = false;
  bool has_learned_region_ = false;
  int failures_ = 0;
  int redirect_count_ = 0;
  std::int64_t received_bytes_ = 0;  // of kExact: they stay
  base::MonotonicTime not_before_;

  // Of this attempt:
  Address url_;  // of HTTP
  Credentials credentials_ = Credentials::kNone;
  ResponseHead head_;
  bool is_body_ = false;
  bool is_drained_ = false;  // broken off, because the error is long
  std::int64_t body_size_ = -1;
  std::int64_t body_bytes_ = 0;
  std::string error_body_;
};

// All jobs of one call.
class FetchLoop {
 public:
  FetchLoop(RemoteClient* client, absl::Span<FetchJob> jobs)
      : client_(client),
        jobs_(jobs),
        window_(2 * static_cast<std::size_t>(std::max(1, client->options().max_requests_per_host))),
        fetchings_(jobs.size()),
        group_(client->engine()) {}

  absl::Status Run(bool stops_at_error, const base::Cancellation& cancellation) {
    for (std::size_t i = 0; i < jobs_.size(); ++i) {
      jobs_[i].status = absl::CancelledError(
          absl::StrCat(NameOf(jobs_[i].address), ": not read, since another read failed"));
      fetchings_[i].Init(client_, &jobs_[i]);
    }
    std::size_t open_count = jobs_.size();
    while (open_count > 0) {
      while (const auto index = NextReady()) {
        if (!Begin(*index)) {
          --open_count;
        }
        if (stops_at_error && !first_error_.ok()) {
          return first_error_;
        }
      }
      if (open_count == 0) {
        return first_error_;
      }
      const base::MonotonicTime until = waiting_.empty() || group_.running_count() >= window_
                                            ? base::MonotonicTime::InfiniteFuture()
                                            : waiting_.begin()->first;
      const auto finished = group_.Await(cancellation, until);
      if (!finished.ok()) {
        EndOpenJobs(finished.status());
        return finished.status();
      }
      if (!finished->has_value()) {
        continue;
      }
      const std::size_t index = (*finished)->id;
      if (!TakeNext(index, fetchings_[index].TakeResult((*finished)->result))) {
        --open_count;
        if (stops_at_error && !first_error_.ok()) {
          return first_error_;
        }
      }
    }
    return first_error_;
  }

 private:
  // A job to begin now: one whose wait is over, else a new one. None while the window is full.
  std::optional<std::size_t> NextReady() {
    if (group_.running_count() >= window_) {
      return std::nullopt;
    }
    if (!ready_.empty()) {
      const std::size_t index = ready_.back();
      ready_.pop_back();
      return index;
    }
    if (!waiting_.empty() && waiting_.begin()->first <= base::MonotonicNow()) {
      const std::size_t index = waiting_.begin()->second;
      waiting_.erase(waiting_.begin());
      return index;
    }
    if (next_new_ < jobs_.size()) {
      return next_new_++;
    }
    return std::nullopt;
  }

  // False if the job is done, with an error.
  bool Begin(std::size_t index) {
    absl::StatusOr<TransferRequest> request = fetchings_[index].Prepare();
    if (!request.ok()) {
      jobs_[index].status = request.status();
      return TakeNext(index, Fetching::Next::kDone);
    }
    group_.Start(index, *std::move(request), &fetchings_[index]);
    return true;
  }

  // False if the job is done.
  bool TakeNext(std::size_t index, Fetching::Next next) {
    switch (next) {
      case Fetching::Next::kNow:
        ready_.push_back(index);
        return true;
      case Fetching::Next::kLater:
        waiting_.emplace(fetchings_[index].not_before(), index);
        return true;
      case Fetching::Next::kDone:
        break;
    }
    is_done_.insert(index);
    first_error_ = first_error_.ok() ? jobs_[index].status : first_error_;
    return false;
  }

  void EndOpenJobs(const absl::Status& status) {
    for (std::size_t i = 0; i < jobs_.size(); ++i) {
      if (is_done_.count(i) == 0) {
        jobs_[i].status = absl::Status(
            status.code(), absl::StrCat(NameOf(jobs_[i].address), ": ", status.message()));
      }
    }
  }

  RemoteClient* const client_;
  const absl::Span<FetchJob> jobs_;
  const std::size_t window_;
  std::vector<Fetching> fetchings_;
  std::vector<std::size_t> ready_;
  std::set<std::pair<base::MonotonicTime, std::size_t>> waiting_;
  std::set<std::size_t> is_done_;
  std::size_t next_new_ = 0;
  absl::Status first_error_;
  TransferGroup group_;  // last: its end takes the sinks away
};

}  // namespace

absl::Status Fetch(RemoteClient* client, absl::Span<FetchJob> jobs, bool stops_at_error,
                   const base::Cancellation& cancellation) {
  return FetchLoop(client, jobs).Run(stops_at_error, cancellation);
}

std::optional<ContentRange> ParseContentRange(absl::string_view text) {
  constexpr absl::string_view kUnit = "bytes ";
  if (!absl::StartsWithIgnoreCase(text, kUnit)) {
    return std::nullopt;
  }
  text = absl::StripAsciiWhitespace(text.substr(kUnit.size()));
  const auto parse = [](absl::string_view digits, std::int64_t* number) {
    return !digits.empty() && digits.size() <= 18 &&
           std::all_of(digits.begin(), digits.end(),
                       [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); }) &&
           absl::SimpleAtoi(digits, number);
  };
  const std::size_t slash = text.find('/');
  if (slash == absl::string_view::npos) {
    return std::nullopt;
  }
  ContentRange range;
  const absl::string_view total = text.substr(slash + 1);
  if (total != "*" && !parse(total, &range.total)) {
    return std::nullopt;
  }
  const absl::string_view span = text.substr(0, slash);
  if (span == "*") {
    return range.total >= 0 ? std::optional<ContentRange>(range) : std::nullopt;
  }
  const std::size_t dash = span.find('-');
  if (dash == absl::string_view::npos || !parse(span.substr(0, dash), &range.first) ||
      !parse(span.substr(dash + 1), &range.last) || range.last < range.first ||
      (range.total >= 0 && range.last >= range.total)) {
    return std::nullopt;
  }
  return range;
}

}  // namespace isoscope::source
