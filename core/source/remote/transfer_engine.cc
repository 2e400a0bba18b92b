// The loop of the engine's thread:
//
// 1. Take what callers have submitted and cancelled since.
// 2. Start queued transfers, the oldest first, whose origin has a place.
// 3. Let libcurl work (curl_multi_perform), which calls OnHeaderLine and OnBody.
// 4. Hand over what has finished.
// 5. Break off what has stalled.
// 6. Wait for a socket, the next stall, or a caller (curl_multi_wakeup).
//
// States of a transfer, and what leads to the next:
//
//   queued     -> active     its origin has a place
//   active     -> finished   libcurl is done, its sink refused, or it stalled
//   any        -> dropped    its caller took the sink away
//
// Locks: Loop::mutex_ guards the two lists that callers write. Transfer::mutex guards the sink, and is
// held while the sink is called. Mailbox::mutex guards results. A thread holds one of them at a time,
// but for the engine's, which holds none when it calls libcurl, and takes Transfer::mutex in its
// callbacks.

#include "core/source/remote/transfer_engine.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <deque>
#include <thread>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include <curl/curl.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/printable.h"
#include "core/base/units.h"

namespace isoscope::source {
namespace {

using Outcome = TransferResult::Outcome;

constexpr std::size_t kMaxActive = 128;   // transfers of all origins at a time
constexpr long kMaxIdleConnections = 64;  // that libcurl keeps
constexpr std::size_t kMaxHeadBytes = 64 * static_cast<std::size_t>(base::kKiB);
constexpr long kReceiveBytes = 256 * base::kKiB;
constexpr absl::Duration kIdleWait = absl::Seconds(60);

// libcurl's own errors that another attempt can't mend.
bool IsFinal(CURLcode code) {
  switch (code) {
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_CERTPROBLEM:
    case CURLE_SSL_CIPHER:
    case CURLE_SSL_ISSUER_ERROR:
    case CURLE_UNSUPPORTED_PROTOCOL:
    case CURLE_URL_MALFORMAT:
    case CURLE_NOT_BUILT_IN:
    case CURLE_BAD_FUNCTION_ARGUMENT:
      return true;
    default:
      return false;
  }
}

// 169.254.0.0/16, fe80::/10 and fd00:ec2::254: machines of clouds answer there with credentials.
bool IsLinkLocal(const sockaddr* address) {
  if (address->sa_family == AF_INET) {
    const auto* const v4 = reinterpret_cast<const sockaddr_in*>(address);
    return ntohl(v4->sin_addr.s_addr) >> 16 == 0xa9fe;
  }
  if (address->sa_family == AF_INET6) {
    const in6_addr& v6 = reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr;
    constexpr std::array<std::uint8_t, 16> kAmazon = {0xfd, 0, 0x0e, 0xc2, 0, 0, 0, 0,
                                                      0,    0, 0,    0,    0, 0, 2, 0x54};
    return IN6_IS_ADDR_LINKLOCAL(&v6) || std::equal(kAmazon.begin(), kAmazon.end(), v6.s6_addr) ||
           (IN6_IS_ADDR_V4MAPPED(&v6) && v6.s6_addr[12] == 169 && v6.s6_addr[13] == 254);
  }
  return false;
}

struct HeaderListFree {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};

}  // namespace

struct TransferGroup::Mailbox {
  base::Mutex mutex;
  base::CondVar changed;
  std::deque<Finished> finished ABSL_GUARDED_BY(mutex);
};

struct TransferGroup::Transfer {
  Transfer(std::size_t transfer_id, TransferRequest transfer_request, TransferSink* transfer_sink,
           std::shared_ptr<Mailbox> transfer_mailbox)
      : id(transfer_id),
        request(std::move(transfer_request)),
        mailbox(std::move(transfer_mailbox)),
        sink(transfer_sink) {}

  const std::size_t id;
  const TransferRequest request;
  const std::shared_ptr<Mailbox> mailbox;

  base::Mutex mutex;
  TransferSink* sink ABSL_GUARDED_BY(mutex);  // null: the caller has gone

  // Of the engine's thread alone:
  CURL* handle = nullptr;
  std::unique_ptr<curl_slist, HeaderListFree> headers;
  std::array<char, CURL_ERROR_SIZE> error_text{};
  ResponseHead head;
  std::size_t head_bytes = 0;
  bool has_head = false;
  bool is_link_local = false;
  absl::Status stop;  // why a callback ended the transfer
  Outcome stop_outcome = Outcome::kStopped;
  base::MonotonicTime started;
  std::int64_t received_bytes = 0;
  base::MonotonicTime window_begin;  // of the stretch that must bring stall_bytes
  std::int64_t window_bytes = 0;     // received before it
};

// Owns libcurl's handles. All but Submit, Cancel and Stop runs on the engine's thread.
class TransferEngine::Loop {
 public:
  using Transfer = TransferGroup::Transfer;
  using TransferPtr = std::shared_ptr<Transfer>;

  Loop() : multi_(curl_multi_init()) {
    ISOSCOPE_CHECK(multi_ != nullptr);
    curl_multi_setopt(multi_, CURLMOPT_PIPELINING, CURLPIPE_MULTIPLEX);
    curl_multi_setopt(multi_, CURLMOPT_MAXCONNECTS, kMaxIdleConnections);
    thread_ = std::thread([this] { Run(); });
  }
  ~Loop() {
    {
      const base::MutexLock lock(&mutex_);
      is_stopping_ = true;
      curl_multi_wakeup(multi_);  // under the lock: the thread ends multi_
    }
    thread_.join();
  }
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  void Submit(TransferPtr transfer) {
    {
      const base::MutexLock lock(&mutex_);
      submitted_.push_back(std::move(transfer));
    }
    curl_multi_wakeup(multi_);
  }
  void Cancel(TransferPtr transfer) {
    {
      const base::MutexLock lock(&mutex_);
      cancelled_.push_back(std::move(transfer));
    }
    curl_multi_wakeup(multi_);
  }

 private:
  void Run() {
    // OpenSSL writes to connections that the other side has closed. Only this thread calls libcurl,
    // which leaves the signal alone (CURLOPT_NOSIGNAL).
    sigset_t pipe;
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
    while (TakeLists()) {
      StartQueued();
      int running = 0;
      curl_multi_perform(multi_, &running);
      FinishDone();
      const base::MonotonicTime wake = BreakStalled();
      const absl::Duration wait =
          std::clamp(wake - base::MonotonicNow(), absl::ZeroDuration(), kIdleWait);
      const bool can_start = !queued_.empty() && FindStartable() != queued_.end();
      const auto wait_ms = static_cast<int>(absl::ToInt64Milliseconds(wait)) + 1;
      curl_multi_poll(multi_, nullptr, 0, can_start ? 0 : wait_ms, nullptr);
    }
    for (const TransferPtr& transfer : active_) {
      Release(transfer.get());
    }
    curl_multi_cleanup(multi_);
  }

  // 1. False: the engine ends.
  bool TakeLists() {
    std::vector<TransferPtr> cancelled;
    {
      const base::MutexLock lock(&mutex_);
      if (is_stopping_) {
        return false;
      }
      queued_.insert(queued_.end(), submitted_.begin(), submitted_.end());
      submitted_.clear();
      cancelled.swap(cancelled_);
    }
    for (const TransferPtr& transfer : cancelled) {
      const auto queued = std::find(queued_.begin(), queued_.end(), transfer);
      if (queued != queued_.end()) {
        queued_.erase(queued);
      }
      const auto active = std::find(active_.begin(), active_.end(), transfer);
      if (active != active_.end()) {
        Release(transfer.get());
        active_.erase(active);
      }
    }
    return true;
  }

  std::deque<TransferPtr>::iterator FindStartable() {
    if (active_.size() >= kMaxActive) {
      return queued_.end();
    }
    return std::find_if(queued_.begin(), queued_.end(), [this](const TransferPtr& transfer) {
      const auto count = active_of_origin_.find(transfer->request.origin);
      return count == active_of_origin_.end() || count->second < transfer->request.max_per_origin;
    });
  }

  // 2.
  void StartQueued() {
    for (auto next = FindStartable(); next != queued_.end(); next = FindStartable()) {
      const TransferPtr transfer = *next;
      queued_.erase(next);
      transfer->handle = curl_easy_init();
      if (transfer->handle == nullptr) {
        Post(*transfer, {.outcome = Outcome::kFailed,
                         .status = absl::ResourceExhaustedError("no memory for a request")});
        continue;
      }
      SetUp(transfer.get());
      ++active_of_origin_[transfer->request.origin];
      active_.push_back(transfer);
      curl_multi_add_handle(multi_, transfer->handle);
    }
  }

  static void SetUp(Transfer* transfer) {
    CURL* const handle = transfer->handle;
    const TransferRequest& request = transfer->request;
    const auto set = [handle](CURLoption option, auto value) {
      const CURLcode code = curl_easy_setopt(handle, option, value);
      ISOSCOPE_CHECK(code == CURLE_OK);
    };
    for (const Secret& header : request.headers) {
      curl_slist* const longer =
          curl_slist_append(transfer->headers.get(), header.Reveal().c_str());
      ISOSCOPE_CHECK(longer != nullptr);
      static_cast<void>(transfer->headers.release());
      transfer->headers.reset(longer);
    }
    set(CURLOPT_URL, request.url.Reveal().c_str());
    set(CURLOPT_HTTPHEADER, transfer->headers.get());
    set(CURLOPT_PRIVATE, transfer);
    set(CURLOPT_ERRORBUFFER, transfer->error_text.data());
    // Nothing but the two schemes, no redirects, no user names, no ".." that libcurl resolves.
    set(CURLOPT_PROTOCOLS_STR, "http,https");
    set(CURLOPT_REDIR_PROTOCOLS_STR, "http,https");
    set(CURLOPT_FOLLOWLOCATION, 0L);
    set(CURLOPT_DISALLOW_USERNAME_IN_URL, 1L);
    set(CURLOPT_PATH_AS_IS, 1L);
    // Bytes as they are stored.
    set(CURLOPT_HTTP_CONTENT_DECODING, 0L);
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_2TLS));
    // With TLS the handshake tells whether a connection takes more requests. Without TLS only the
    // first answer would tell: all requests would wait for a server that does not give it.
    set(CURLOPT_PIPEWAIT,
        request.awaits_multiplexing && absl::StartsWith(request.origin, "https://") ? 1L : 0L);
    set(CURLOPT_BUFFERSIZE, kReceiveBytes);
    set(CURLOPT_SUPPRESS_CONNECT_HEADERS, 1L);
    // No signals, and no wait for a name server when a transfer is broken off.
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_QUICK_EXIT, 1L);
    set(CURLOPT_TCP_KEEPALIVE, 1L);
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(std::max<std::int64_t>(
                                       1, absl::ToInt64Milliseconds(request.connect_timeout))));
    if (!request.ca_file.empty()) {
      set(CURLOPT_CAINFO, request.ca_file.c_str());
      set(CURLOPT_CAPATH, static_cast<const char*>(nullptr));
    }
    if (request.proxy.has_value()) {
      set(CURLOPT_PROXY, request.proxy->c_str());  // empty: none, whatever variables say
    }
    set(CURLOPT_OPENSOCKETFUNCTION, &Loop::OpenSocket);
    set(CURLOPT_OPENSOCKETDATA, transfer);
    set(CURLOPT_HEADERFUNCTION, &Loop::OnHeaderLine);
    set(CURLOPT_HEADERDATA, transfer);
    set(CURLOPT_WRITEFUNCTION, &Loop::OnBody);
    set(CURLOPT_WRITEDATA, transfer);
    transfer->started = base::MonotonicNow();
  }

  static curl_socket_t OpenSocket(void* data, curlsocktype /*purpose*/, curl_sockaddr* address) {
    if (IsLinkLocal(&address->addr)) {
      static_cast<Transfer*>(data)->is_link_local = true;
      return CURL_SOCKET_BAD;
    }
    return socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
  }

  // A line of the headers with its end. Returns another number than its size to end the transfer.
  static std::size_t OnHeaderLine(char* bytes, std::size_t /*one*/, std::size_t size, void* data) {
    auto* const transfer = static_cast<Transfer*>(data);
    return TakeHeaderLine(transfer, absl::string_view(bytes, size)) ? size : size + 1;
  }

  static bool Stop(Transfer* transfer, absl::Status status, Outcome outcome) {
    transfer->stop = std::move(status);
    transfer->stop_outcome = outcome;
    return false;
  }

  static bool TakeHeaderLine(Transfer* transfer, absl::string_view line) {
    transfer->head_bytes += line.size();
    if (transfer->head_bytes > kMaxHeadBytes) {
      return Stop(transfer,
                  absl::FailedPreconditionError(absl::StrCat("the server sends more than ",
                                                             kMaxHeadBytes, " bytes of headers")),
                  Outcome::kFailed);
    }
    if (transfer->has_head) {
      return true;  // trailers, behind the body
    }
    if (absl::StartsWith(line, "HTTP/")) {  // of an interim answer, or of the final one
      transfer->head = {};
      const std::size_t space = line.find(' ');
      int status = 0;
      if (space == absl::string_view::npos ||
          !absl::SimpleAtoi(line.substr(space + 1, 3), &status)) {
        return Stop(transfer, absl::FailedPreconditionError("the server speaks no HTTP"),
                    Outcome::kFailed);
      }
      transfer->head.status = status;
      return true;
    }
    const absl::string_view words = absl::StripAsciiWhitespace(line);
    if (words.empty()) {
      return transfer->head.status < 200 || EndHead(transfer);
    }
    const std::size_t colon = words.find(':');
    if (colon == absl::string_view::npos || line[0] == ' ' || line[0] == '\t') {
      return true;  // no header that we need goes over two lines
    }
    const std::string name = absl::AsciiStrToLower(words.substr(0, colon));
    const std::string value(absl::StripAsciiWhitespace(words.substr(colon + 1)));
    const auto [found, is_new] = transfer->head.headers.emplace(name, value);
    const bool decides = name == "content-range" || name == "etag" || name == "location" ||
                         name == "content-length" || name == "content-encoding";
    if (!is_new && decides && found->second != value) {
      return Stop(transfer,
                  absl::FailedPreconditionError(
                      absl::StrCat("the server sends two different headers ", name)),
                  Outcome::kFailed);
    }
    return true;
  }

  static bool EndHead(Transfer* transfer) {
    transfer->has_head = true;
    transfer->window_begin = base::MonotonicNow();
    const base::MutexLock lock(&transfer->mutex);
    if (transfer->sink == nullptr) {
      return Stop(transfer, absl::CancelledError("abandoned"), Outcome::kStopped);
    }
    absl::Status status = transfer->sink->OnHead(transfer->head);
    return status.ok() || Stop(transfer, std::move(status), Outcome::kStopped);
  }

  static std::size_t OnBody(char* bytes, std::size_t /*one*/, std::size_t size, void* data) {
    auto* const transfer = static_cast<Transfer*>(data);
    transfer->received_bytes += static_cast<std::int64_t>(size);
    const base::MutexLock lock(&transfer->mutex);
    if (transfer->sink == nullptr) {
      return Stop(transfer, absl::CancelledError("abandoned"), Outcome::kStopped) ? size : 0;
    }
    absl::Status status = transfer->sink->OnBytes(absl::string_view(bytes, size));
    if (!status.ok()) {
      Stop(transfer, std::move(status), Outcome::kStopped);
      return size == 0 ? 1 : 0;
    }
    return size;
  }

  // 4.
  void FinishDone() {
    int left = 0;
    while (const CURLMsg* const message = curl_multi_info_read(multi_, &left)) {
      if (message->msg != CURLMSG_DONE) {
        continue;
      }
      const CURLcode code = message->data.result;
      const auto active =
          std::find_if(active_.begin(), active_.end(), [message](const TransferPtr& transfer) {
            return transfer->handle == message->easy_handle;
          });
      ISOSCOPE_CHECK(active != active_.end());
      const TransferPtr transfer = *active;
      Release(transfer.get());
      active_.erase(active);
      Post(*transfer, ResultOf(transfer.get(), code));
    }
  }

  static TransferResult ResultOf(Transfer* transfer, CURLcode code) {
    if (!transfer->stop.ok()) {
      return {.outcome = transfer->stop_outcome, .status = std::move(transfer->stop)};
    }
    if (transfer->is_link_local) {
      return {.outcome = Outcome::kFailed,
              .status = absl::PermissionDeniedError(
                  "the host is at a link-local address, where no data are read from")};
    }
    if (code == CURLE_OK) {
      return transfer->has_head
                 ? TransferResult{}
                 : TransferResult{.outcome = Outcome::kBroken,
                                  .status = absl::UnavailableError("the server sent no answer")};
    }
    const absl::string_view detail(transfer->error_text.data());
    // Schemes are checked before: what curl does not know is the answer.
    const std::string text =
        code == CURLE_UNSUPPORTED_PROTOCOL
            ? "the server's answer is no HTTP"
            : absl::StrCat(
                  curl_easy_strerror(code),
                  detail.empty() ? "" : absl::StrCat(": ", base::Escaped(base::CutText(detail))));
    if (IsFinal(code)) {
      const bool is_certificate =
          code == CURLE_PEER_FAILED_VERIFICATION || code == CURLE_SSL_CACERT_BADFILE;
      return {
          .outcome = Outcome::kFailed,
          .status = absl::FailedPreconditionError(absl::StrCat(
              text, is_certificate ? "; ISOSCOPE_CA_FILE names the authorities to trust" : ""))};
    }
    return {.outcome = Outcome::kBroken, .status = absl::UnavailableError(text)};
  }

  // 5. Returns when the next transfer may have stalled.
  base::MonotonicTime BreakStalled() {
    base::MonotonicTime next = base::MonotonicTime::InfiniteFuture();
    const base::MonotonicTime now = base::MonotonicNow();
    for (std::size_t i = 0; i < active_.size();) {
      const TransferPtr transfer = active_[i];
      const TransferRequest& request = transfer->request;
      std::string fault;
      if (!transfer->has_head) {
        const base::MonotonicTime end = transfer->started + request.head_timeout;
        if (now >= end) {
          fault = absl::StrCat("no answer within ", absl::FormatDuration(request.head_timeout));
        }
        next = std::min(next, end);
      } else {
        const std::int64_t bytes = transfer->received_bytes - transfer->window_bytes;
        if (now >= transfer->window_begin + request.stall_timeout) {
          if (bytes < request.stall_bytes) {
            fault = absl::StrCat("stalled: ", bytes, " bytes within ",
                                 absl::FormatDuration(request.stall_timeout), ", expected ",
                                 request.stall_bytes);
          }
          transfer->window_begin = now;
          transfer->window_bytes = transfer->received_bytes;
        }
        next = std::min(next, transfer->window_begin + request.stall_timeout);
      }
      if (fault.empty()) {
        ++i;
        continue;
      }
      Release(transfer.get());
      active_.erase(active_.begin() + static_cast<std::ptrdiff_t>(i));
      Post(*transfer, {.outcome = Outcome::kBroken, .status = absl::UnavailableError(fault)});
    }
    return next;
  }

  // The transfer's place is free. Its handle is not used again, because libcurl keeps buffers in it
  // that can't be set anew; its connection is.
  void Release(Transfer* transfer) {
    CURL* const handle = std::exchange(transfer->handle, nullptr);
    curl_multi_remove_handle(multi_, handle);
    const auto count = active_of_origin_.find(transfer->request.origin);
    if (--count->second == 0) {
      active_of_origin_.erase(count);
    }
    curl_easy_cleanup(handle);
  }

  static void Post(const Transfer& transfer, TransferResult result) {
    TransferGroup::Mailbox& mailbox = *transfer.mailbox;
    const base::MutexLock lock(&mailbox.mutex);
    mailbox.finished.push_back({.id = transfer.id, .result = std::move(result)});
    mailbox.changed.SignalAll();
  }

  CURLM* const multi_;
  std::vector<TransferPtr> active_;
  std::deque<TransferPtr> queued_;
  std::map<std::string, int> active_of_origin_;

  base::Mutex mutex_;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<TransferPtr> submitted_ ABSL_GUARDED_BY(mutex_);
  std::vector<TransferPtr> cancelled_ ABSL_GUARDED_BY(mutex_);

  std::thread thread_;  // last: it uses all of the above
};

TransferGroup::TransferGroup(std::shared_ptr<TransferEngine> engine)
    : engine_(std::move(engine)), mailbox_(std::make_shared<Mailbox>()) {}

TransferGroup::~TransferGroup() {
  while (!running_.empty()) {
    Abandon(running_.begin()->first);
  }
}

void TransferGroup::Start(std::size_t id, TransferRequest request, TransferSink* sink) {
  auto transfer = std::make_shared<Transfer>(id, std::move(request), sink, mailbox_);
  ISOSCOPE_CHECK(running_.emplace(id, transfer).second);
  engine_->Submit(std::move(transfer));
}

void TransferGroup::Abandon(std::size_t id) {
  const auto running = running_.find(id);
  if (running == running_.end()) {
    return;
  }
  std::shared_ptr<Transfer> transfer = std::move(running->second);
  running_.erase(running);
  {
    const base::MutexLock lock(&transfer->mutex);
    transfer->sink = nullptr;
  }
  engine_->Cancel(std::move(transfer));
}

absl::StatusOr<std::optional<TransferGroup::Finished>> TransferGroup::Await(
    const base::Cancellation& cancellation, base::MonotonicTime until) {
  const base::Cancellation::Callback wake(cancellation, [this] {
    const base::MutexLock lock(&mailbox_->mutex);
    mailbox_->changed.SignalAll();
  });
  const base::MutexLock lock(&mailbox_->mutex);
  while (true) {
    const absl::Status status = cancellation.Check();
    if (!status.ok()) {
      return status;
    }
    while (!mailbox_->finished.empty()) {
      Finished finished = std::move(mailbox_->finished.front());
      mailbox_->finished.pop_front();
      const auto running = running_.find(finished.id);
      if (running != running_.end()) {  // else it was abandoned after it had finished
        running_.erase(running);
        return std::optional<Finished>(std::move(finished));
      }
    }
    if (base::MonotonicNow() >= until) {
      return std::optional<Finished>();
    }
    mailbox_->changed.WaitUntil(&mailbox_->mutex, std::min(cancellation.deadline(), until));
  }
}

std::shared_ptr<TransferEngine> TransferEngine::OfProcess() {
  static const std::shared_ptr<TransferEngine> engine = std::make_shared<TransferEngine>();
  return engine;
}

TransferEngine::TransferEngine()
    : loop_([] {
        // Before the engine is made: what libcurl registers to run at exit runs after its end.
        static const CURLcode initialized = curl_global_init(CURL_GLOBAL_DEFAULT);
        ISOSCOPE_CHECK(initialized == CURLE_OK);
        return std::make_unique<Loop>();
      }()) {}

TransferEngine::~TransferEngine() = default;

void TransferEngine::Submit(std::shared_ptr<TransferGroup::Transfer> transfer) {
  loop_->Submit(std::move(transfer));
}

void TransferEngine::Cancel(std::shared_ptr<TransferGroup::Transfer> transfer) {
  loop_->Cancel(std::move(transfer));
}

}  // namespace isoscope::source
