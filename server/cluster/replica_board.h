// Chooses the agent for each part of a frame, where several agents serve the same shards.
//
// 1. Each shard ranks its agents by rendezvous hashing of (key, shard, address). It takes the first
//    one that does not have its share of the set's shards yet. The key has the isovalues: frames at
//    the same isovalues find warm caches, other frames use other agents. An agent that is added or
//    removed moves few shards.
// 2. The shards of one set that took the same agent make a part. The other agents of the set follow
//    in the order of their ranks: they repeat the part if the first agent is lost.
// 3. If the first agent has more than its share of the parts under way, the least busy agent
//    becomes the first (consistent hashing with bounded loads: Mirrokni, Thorup, Zadimoghaddam,
//    2018). A single client never has so many parts, and keeps its caches.
//
// An agent that failed or was late goes last for a while, longer each time; a completed part resets
// that. A short deadline of a client says nothing about agents. An agent is late if others were
// faster at the same time, or if it was waited for as long as kLateAfter.
//
// Second attempts of slow parts come out of a bucket. Each part that begins adds a share of an
// attempt. Shares above the capacity are lost, so that quiet hours don't pay for a burst.

#ifndef ISOSCOPE_SERVER_CLUSTER_REPLICA_BOARD_H_
#define ISOSCOPE_SERVER_CLUSTER_REPLICA_BOARD_H_

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/volume/inside_rule.h"
#include "server/cluster/frame_part.h"

namespace isoscope::server {

// Returns the key of frames with surfaces of some rules, in any order.
std::string ReplicaKeyOf(absl::string_view dataset_id, std::vector<volume::InsideRule> rules);

// Returns the shards below `shard_count` that no part has, ascending.
std::vector<int> MissingShards(int shard_count, const std::vector<FramePart>& parts);

// Counts the parts that each agent has under way, and its failures. Thread-safe.
class ReplicaBoard {
 public:
  // Counts a part that is under way, while it lives. The board outlives it.
  class Lease {
   public:
    Lease(Lease&& other) noexcept
        : board_(std::exchange(other.board_, nullptr)), address_(std::move(other.address_)) {}
    Lease& operator=(Lease&&) = delete;
    ~Lease() {
      if (board_ != nullptr) {
        board_->Return(address_);
      }
    }

   private:
    friend class ReplicaBoard;
    Lease(ReplicaBoard* board, std::string address) : board_(board), address_(std::move(address)) {}

    ReplicaBoard* board_;
    std::string address_;
  };

  // At most this share of all parts is begun a second time because the first agent is slow.
  static constexpr double kMaxHedgedShare = 0.05;
  // The second attempts that the bucket holds, for parts that come at once.
  static constexpr double kMaxHedgeBurst = 16;
  // An agent that was waited for less is not late, whatever the deadline of its client.
  static constexpr absl::Duration kLateAfter = absl::Milliseconds(500);

  ReplicaBoard() = default;
  ReplicaBoard(const ReplicaBoard&) = delete;
  ReplicaBoard& operator=(const ReplicaBoard&) = delete;

  // Returns the parts of a frame, in order of their first shards: the same for the same sets, key
  // and state of the agents. O(shards * replicas * log replicas).
  [[nodiscard]] std::vector<FramePart> Choose(const std::vector<ReplicaSet>& sets,
                                              absl::string_view key,
                                              base::MonotonicTime now = base::MonotonicNow()) const;

  // Notes that a part is under way on the agent.
  [[nodiscard]] Lease Take(const std::string& address);
  // Takes one of the second attempts that are allowed, if the agent has nothing to do.
  [[nodiscard]] bool TryHedge(const std::string& address);

  // The agent failed, or was late in comparison with others.
  void NoteTrouble(const std::string& address, base::MonotonicTime now = base::MonotonicNow());
  // The agent had not answered when it was no longer waited for. Trouble if that took kLateAfter.
  void NoteUnanswered(const std::string& address, absl::Duration waited,
                      base::MonotonicTime now = base::MonotonicNow());
  void NoteSuccess(const std::string& address);

 private:
  struct Agent {
    int part_count = 0;  // under way
    absl::Duration avoidance;
    base::MonotonicTime avoided_until = base::MonotonicTime::InfinitePast();
  };

  void Return(const std::string& address);
  [[nodiscard]] bool IsWell(const std::string& address, base::MonotonicTime now) const
      ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  [[nodiscard]] int PartCountOf(const std::string& address) const
      ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  void PutIdlestFirst(std::vector<ServingAgent>* replicas, base::MonotonicTime now) const
      ABSL_SHARED_LOCKS_REQUIRED(mutex_);

  mutable base::Mutex mutex_;
  // The agents with parts under way, or in trouble.
  std::map<std::string, Agent, std::less<>> agents_ ABSL_GUARDED_BY(mutex_);
  double hedges_ ABSL_GUARDED_BY(mutex_) = 0;  // in the bucket
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_REPLICA_BOARD_H_
