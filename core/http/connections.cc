// Each connection is in one state, and each count below is of connections in certain states:
//
//   event        waiting            working                dropped
//   BeginWork    working, if        -                      stays, kDropped
//                there is a place
//   EndWork      -                  waiting                stays
//   TryAdd of    dropped, if it     stays                  stays
//   another      is the victim
//
// The victim is found by a walk over all connections, at most some thousands, and only when the
// server is full. It makes room at once: its closer ends the socket on another thread a little
// later, so that somewhat more sockets than the limit may be open meanwhile.

#include "core/http/connections.h"

#include <utility>
#include <vector>

namespace isoscope::http {

std::shared_ptr<Connections::Lease> Connections::TryAdd(const std::string& address) {
  Closer dropped;
  std::shared_ptr<Lease> lease;
  {
    const base::MutexLock lock(&mutex_);
    if (is_closing_) {
      return nullptr;
    }
    if (alive_count_ >= limits_.max_count + limits_.max_entering) {
      Connection* const victim = FindVictim();
      if (victim == nullptr) {
        return nullptr;
      }
      victim->state = State::kDropped;
      --alive_count_;
      ++dropped_count_;
      dropped = victim->closer;
    }
    const std::int64_t id = next_id_++;
    connections_[id] = {.address = address, .since = next_event_++};
    ++alive_count_;
    lease = std::make_shared<Lease>(this, id);
  }
  if (dropped != nullptr) {
    dropped(/*at_once=*/true);
  }
  return lease;
}

Connections::Connection* Connections::FindVictim() {
  std::map<std::string, int> waiting;  // strangers, by address
  for (const auto& [id, connection] : connections_) {
    if (connection.state == State::kWaiting && connection.caller != Caller::kKnown) {
      ++waiting[connection.address];
    }
  }
  Connection* victim = nullptr;
  int victim_share = 0;  // 0: a known caller's
  for (auto& [id, connection] : connections_) {
    if (connection.state != State::kWaiting) {
      continue;
    }
    const int share = connection.caller == Caller::kKnown ? 0 : waiting[connection.address];
    if (victim == nullptr || share > victim_share ||
        (share == victim_share && connection.since < victim->since)) {
      victim = &connection;
      victim_share = share;
    }
  }
  return victim;
}

Placement Connections::BeginWork(std::int64_t id, Caller caller, const std::string& address) {
  const base::MutexLock lock(&mutex_);
  Connection& connection = connections_.at(id);
  if (connection.state == State::kDropped) {
    return Placement::kDropped;
  }
  if (caller == Caller::kHealth && working_health_ < limits_.max_entering / 2) {
    ++working_health_;
  } else {
    caller = caller == Caller::kKnown ? Caller::kKnown : Caller::kStranger;
    const auto stranger_entry = strangers_of_address_.find(address);
    const int stranger_count =
        stranger_entry == strangers_of_address_.end() ? 0 : stranger_entry->second;
    const bool is_stranger = caller == Caller::kStranger;
    if (is_stranger && stranger_count >= limits_.max_of_address) {
      return Placement::kAddressFull;
    }
    if (working_count_ >= limits_.max_count ||
        (is_stranger && working_strangers_ >= limits_.max_strangers)) {
      return Placement::kFull;
    }
    ++working_count_;
    if (is_stranger) {
      ++working_strangers_;
      ++strangers_of_address_[address];
    }
  }
  connection.state = State::kWorking;
  connection.caller = caller;
  connection.work_address = address;
  connection.since = next_event_++;
  return Placement::kTaken;
}

void Connections::StopCountingWork(Connection* connection) {
  if (connection->state != State::kWorking) {
    return;
  }
  if (connection->caller == Caller::kHealth) {
    --working_health_;
    return;
  }
  --working_count_;
  if (connection->caller == Caller::kStranger) {
    --working_strangers_;
    const auto stranger_entry = strangers_of_address_.find(connection->work_address);
    if (--stranger_entry->second == 0) {
      strangers_of_address_.erase(stranger_entry);
    }
  }
}

void Connections::EndWork(std::int64_t id) {
  const base::MutexLock lock(&mutex_);
  Connection& connection = connections_.at(id);
  if (connection.state == State::kWorking) {
    StopCountingWork(&connection);
    connection.state = State::kWaiting;
    connection.since = next_event_++;
  }
}

// NOLINTNEXTLINE(performance-unnecessary-value-param): callers hand it over
void Connections::SetCloser(std::int64_t id, Closer closer) {
  bool at_once = false;
  {
    const base::MutexLock lock(&mutex_);
    Connection& connection = connections_.at(id);
    connection.closer = closer;
    at_once = is_closing_at_once_ || connection.state == State::kDropped;
    if (!is_closing_ && !at_once) {
      return;
    }
  }
  closer(at_once);
}

void Connections::Close(bool at_once) {
  std::vector<Closer> closers;
  {
    const base::MutexLock lock(&mutex_);
    is_closing_ = true;
    is_closing_at_once_ = is_closing_at_once_ || at_once;
    for (const auto& [id, connection] : connections_) {
      if (connection.closer != nullptr) {
        closers.push_back(connection.closer);
      }
    }
  }
  for (const Closer& closer : closers) {
    closer(at_once);
  }
}

bool Connections::is_closing() {
  const base::MutexLock lock(&mutex_);
  return is_closing_;
}

bool Connections::AwaitNone(base::MonotonicTime deadline) {
  base::MutexLock lock(&mutex_);
  while (!connections_.empty()) {
    if (!removed_.WaitUntil(&mutex_, deadline)) {
      return connections_.empty();
    }
  }
  return true;
}

int Connections::count() {
  const base::MutexLock lock(&mutex_);
  return alive_count_;
}

std::int64_t Connections::dropped_count() {
  const base::MutexLock lock(&mutex_);
  return dropped_count_;
}

void Connections::Remove(std::int64_t id) {
  const base::MutexLock lock(&mutex_);
  const auto found = connections_.find(id);
  StopCountingWork(&found->second);
  alive_count_ -= found->second.state == State::kDropped ? 0 : 1;
  connections_.erase(found);
  removed_.SignalAll();
}

}  // namespace isoscope::http
