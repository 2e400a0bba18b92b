#include "server/admission/admission_queue.h"

#include <algorithm>

#include "absl/hash/hash.h"

#include "core/base/check.h"
#include "core/base/monotonic_time.h"

namespace isoscope::server {

absl::Duration AdmissionQueue::Interval() const {
  return mean_duration_.value_or(kGuessedDuration) / limits_.max_working;
}

std::map<std::string, AdmissionQueue::Client>::iterator AdmissionQueue::FindLoser(
    const std::string& client, bool was_refused, Turn turn) {
  const auto own = clients_.find(client);
  const std::size_t own_count = own == clients_.end() ? 0 : own->second.waiting.size();
  auto loser = clients_.end();
  for (auto it = clients_.begin(); it != clients_.end(); ++it) {
    if (loser == clients_.end() || it->second.waiting.size() > loser->second.waiting.size() ||
        (it->second.waiting.size() == loser->second.waiting.size() &&
         it->second.turn > loser->second.turn)) {
      loser = it;
    }
  }
  if (loser == clients_.end() || loser == own) {
    return clients_.end();
  }
  const std::size_t count = loser->second.waiting.size();
  const bool has_far_more = count > own_count + 1;
  const bool came_later = was_refused && own_count == 0 && count == 1 && loser->second.turn > turn;
  return has_far_more || came_later ? loser : clients_.end();
}

AdmissionQueue::Answer AdmissionQueue::Admit(const std::string& client, base::MonotonicTime now) {
  const auto refused = outside_.find(client);
  const bool was_refused = refused != outside_.end() && now <= refused->second.forgotten;
  const Turn turn = was_refused ? refused->second.turn : next_turn_++;
  Answer answer;
  const std::size_t limit =
      static_cast<std::size_t>(limits_.max_working) + static_cast<std::size_t>(limits_.max_waiting);
  if (frames_.size() >= limit) {
    const auto loser = FindLoser(client, was_refused, turn);
    if (loser == clients_.end()) {
      answer.retry_delay = Refuse(client, turn, now);
      return answer;
    }
    const Ticket evicted = loser->second.waiting.back();
    const Frame frame = frames_.at(evicted);
    const Turn loser_turn = loser->second.turn;
    Leave(evicted);
    answer.evicted = evicted;
    answer.retry_delay = Refuse(frame.client, loser_turn, now);
  }
  outside_.erase(client);
  answer.ticket = next_ticket_++;
  frames_[*answer.ticket] = {.client = client, .turn = turn};
  return answer;
}

absl::Duration AdmissionQueue::Refuse(const std::string& client, Turn turn,
                                      base::MonotonicTime now) {
  for (auto it = outside_.begin(); it != outside_.end();) {
    it = now > it->second.forgotten ? outside_.erase(it) : std::next(it);
  }
  const bool keeps_turn =
      !clients_.contains(client) && (outside_.size() < kMaxOutside || outside_.contains(client));
  if (keeps_turn) {
    outside_[client] = {.turn = turn, .forgotten = now};
  }
  // Half of the time until its turn: an estimate with an error of this size is still in time.
  const double ahead = static_cast<double>(deadlines_.size() + outside_.size());
  constexpr std::size_t kSpreads = 1024;
  const double spread =
      0.75 + 0.5 *
                 static_cast<double>(absl::Hash<std::pair<std::string, Turn>>()({client, turn}) %
                                     kSpreads) /
                 kSpreads;
  const absl::Duration delay =
      std::clamp(Interval() * (ahead / 2 * spread), kMinRetryDelay, kMaxRetryDelay);
  if (keeps_turn) {
    outside_[client].forgotten = now + 2 * delay + absl::Seconds(1);
  }
  return delay;
}

void AdmissionQueue::Join(Ticket ticket, base::MonotonicTime deadline) {
  Frame& frame = frames_.at(ticket);
  ISOSCOPE_CHECK(frame.state == State::kAdmitted);
  frame.state = State::kWaiting;
  frame.deadline = deadline;
  deadlines_.emplace(deadline, ticket);
  const auto [client, is_new] = clients_.try_emplace(frame.client);
  if (is_new) {
    // The turn is used up if the frame before it, of the same client, was admitted with it.
    client->second.turn = line_.contains(frame.turn) ? next_turn_++ : frame.turn;
    line_[client->second.turn] = frame.client;
  }
  client->second.waiting.push_back(ticket);
}

std::optional<AdmissionQueue::Ticket> AdmissionQueue::TakeNext(base::MonotonicTime now) {
  if (line_.empty()) {
    return std::nullopt;
  }
  const auto first = line_.begin();
  const auto client = clients_.find(first->second);
  const Ticket ticket = client->second.waiting.front();
  Frame& frame = frames_.at(ticket);
  RemoveWaiting(ticket, frame);
  // A client with more frames goes to the end of the queue.
  if (const auto left = clients_.find(frame.client); left != clients_.end()) {
    line_.erase(left->second.turn);
    left->second.turn = next_turn_++;
    line_[left->second.turn] = frame.client;
  }
  frame.state = State::kWorking;
  frame.begin = now;
  ++working_count_;
  return ticket;
}

void AdmissionQueue::RemoveWaiting(Ticket ticket, const Frame& frame) {
  deadlines_.erase({frame.deadline, ticket});
  const auto client = clients_.find(frame.client);
  std::deque<Ticket>& waiting = client->second.waiting;
  waiting.erase(std::find(waiting.begin(), waiting.end(), ticket));
  if (waiting.empty()) {
    line_.erase(client->second.turn);
    clients_.erase(client);
  }
}

bool AdmissionQueue::Leave(Ticket ticket) {
  const auto it = frames_.find(ticket);
  if (it == frames_.end() || it->second.state != State::kWaiting) {
    return false;
  }
  RemoveWaiting(ticket, it->second);
  frames_.erase(it);
  return true;
}

std::vector<AdmissionQueue::Ticket> AdmissionQueue::Expire(base::MonotonicTime now) {
  std::vector<Ticket> expired;
  while (!deadlines_.empty() && deadlines_.begin()->first < now) {
    const Ticket ticket = deadlines_.begin()->second;
    Leave(ticket);
    expired.push_back(ticket);
  }
  return expired;
}

void AdmissionQueue::End(Ticket ticket, base::MonotonicTime now) {
  const auto it = frames_.find(ticket);
  if (it == frames_.end()) {
    return;
  }
  if (it->second.state == State::kWaiting) {
    Leave(ticket);
    return;
  }
  if (it->second.state == State::kWorking) {
    --working_count_;
    // About the last sixteen frames count: frames of a cluster differ by view and size, not by
    // client.
    constexpr double kNewShare = 1.0 / 16;
    const absl::Duration duration = std::max(now - it->second.begin, absl::ZeroDuration());
    mean_duration_ = mean_duration_.has_value()
                         ? *mean_duration_ + (duration - *mean_duration_) * kNewShare
                         : duration;
  }
  frames_.erase(it);
}

}  // namespace isoscope::server
