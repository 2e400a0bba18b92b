#include "server/admission/admission.h"

#include <cstddef>
#include <optional>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"

namespace isoscope::server {
namespace {

absl::Status CoordinatorStops() {
  return base::WithReason(absl::UnavailableError("the coordinator stops: try another, or later"),
                          base::ErrorReason::kServerStops);
}

}  // namespace
namespace {

std::string Milliseconds(absl::Duration duration) {
  return absl::StrCat(absl::ToInt64Milliseconds(absl::Ceil(duration, absl::Milliseconds(1))),
                      " ms");
}

}  // namespace

Admission::Admission(AdmissionOptions options)
    : options_(std::move(options)), queue_(options_.limits) {
  const AdmissionLimits& limits = options_.limits;
  ISOSCOPE_CHECK_GE(limits.max_working, 1);
  ISOSCOPE_CHECK_GE(limits.max_waiting, 0);
  frame_threads_.reserve(static_cast<std::size_t>(limits.max_working));
  for (int i = 0; i < limits.max_working; ++i) {
    frame_threads_.emplace_back([this] { RunFrames(); });
  }
  ending_thread_ = std::thread([this] { RunEndings(); });
}

Admission::~Admission() {
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    while (!waiting_.empty()) {
      const Ticket ticket = waiting_.begin()->first;
      queue_.Leave(ticket);
      EndWith(ticket, CoordinatorStops());
    }
    joined_.SignalAll();
  }
  for (std::thread& thread : frame_threads_) {
    thread.join();
  }
  {
    // No work can schedule more from here on.
    const base::MutexLock lock(&mutex_);
    is_last_ended_ = true;
    ending_.SignalAll();
  }
  ending_thread_.join();
}

std::string Admission::Describe() const {
  return absl::StrCat(queue_.working_count(), " ", options_.noun, "s are in work and ",
                      queue_.waiting_count(), " wait, of ", queue_.waiting_client_count(),
                      " clients (limits: ", options_.limits.max_working, " and ",
                      options_.limits.max_waiting, options_.flags.empty() ? "" : "; ",
                      options_.flags, ")");
}

absl::StatusOr<Admission::Place> Admission::Admit(const std::string& client) {
  const base::MutexLock lock(&mutex_);
  ExpireFrames();
  const AdmissionQueue::Answer answer = queue_.Admit(client, base::MonotonicNow());
  if (answer.evicted.has_value()) {
    EndWith(*answer.evicted,
            base::WithRetryDelay(
                absl::ResourceExhaustedError(absl::StrCat(
                    "the ", options_.noun,
                    " made room in the line for that of another client, which has fewer there or "
                    "came first; ",
                    Describe(), ": retry later, in ", Milliseconds(answer.retry_delay))),
                answer.retry_delay));
  }
  if (answer.ticket.has_value()) {
    return Place(this, *answer.ticket);
  }
  return base::WithRetryDelay(
      absl::ResourceExhaustedError(
          absl::StrCat(Describe(), ": retry later, in ", Milliseconds(answer.retry_delay))),
      answer.retry_delay);
}

void Admission::Schedule(Ticket ticket, base::MonotonicTime deadline, Work work) {
  const base::MutexLock lock(&mutex_);
  const bool is_first = deadline < queue_.next_deadline();
  queue_.Join(ticket, deadline);
  waiting_[ticket] = {.work = std::move(work), .arrival = base::MonotonicNow()};
  if (is_stopping_) {
    queue_.Leave(ticket);
    EndWith(ticket, CoordinatorStops());
    return;
  }
  joined_.Signal();
  if (is_first) {
    ending_.Signal();
  }
}

void Admission::Leave(Ticket ticket) {
  const base::MutexLock lock(&mutex_);
  if (queue_.Leave(ticket)) {
    EndWith(ticket, absl::CancelledError(absl::StrCat(
                        "the ", options_.noun, " was cancelled while it waited for its turn")));
  }
}

void Admission::End(Ticket ticket) {
  Work unused;  // destroyed without the lock
  const base::MutexLock lock(&mutex_);
  queue_.End(ticket, base::MonotonicNow());
  const auto it = waiting_.find(ticket);
  if (it != waiting_.end()) {
    unused = std::move(it->second.work);
    waiting_.erase(it);
  }
}

Admission::Counts Admission::counts() const {
  const base::MutexLock lock(&mutex_);
  return {.working = queue_.working_count(),
          .waiting = queue_.waiting_count(),
          .waiting_clients = queue_.waiting_client_count(),
          .outside_clients = queue_.outside_count()};
}

void Admission::EndWith(Ticket ticket, absl::Status status) {
  const auto it = waiting_.find(ticket);
  ended_.push_back({std::move(it->second.work), std::move(status)});
  waiting_.erase(it);
  ending_.Signal();
}

void Admission::ExpireFrames() {
  const base::MonotonicTime now = base::MonotonicNow();
  for (const Ticket ticket : queue_.Expire(now)) {
    EndWith(ticket,
            absl::DeadlineExceededError(absl::StrCat(
                "the ", options_.noun, " waited ", Milliseconds(now - waiting_.at(ticket).arrival),
                " for its turn, and its deadline has passed; ", Describe())));
  }
}

void Admission::RunFrames() {
  while (true) {
    Work work;
    {
      base::MutexLock lock(&mutex_);
      std::optional<Ticket> ticket;
      joined_.Await(&mutex_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
        ExpireFrames();
        ticket = queue_.TakeNext(base::MonotonicNow());
        return ticket.has_value() || is_stopping_;
      });
      if (!ticket.has_value()) {
        return;
      }
      const auto it = waiting_.find(*ticket);
      work = std::move(it->second.work);
      waiting_.erase(it);
    }
    work(absl::OkStatus());
  }
}

void Admission::RunEndings() {
  while (true) {
    Ended ended;
    {
      base::MutexLock lock(&mutex_);
      ExpireFrames();
      while (ended_.empty() && !is_last_ended_) {
        ending_.WaitUntil(&mutex_, queue_.next_deadline());
        ExpireFrames();
      }
      if (ended_.empty()) {
        return;
      }
      ended = std::move(ended_.front());
      ended_.pop_front();
    }
    ended.work(ended.status);
  }
}

}  // namespace isoscope::server
