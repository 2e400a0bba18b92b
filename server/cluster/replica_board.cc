// Example: a set of 6 shards with agents a, b and c, of which c failed a moment ago.
//
//   share     6 shards / 2 agents without trouble = 3 shards an agent
//   shard 0   ranks b, a, then c (in trouble): b takes it
//   ...       as soon as b has 3 shards, the next ones go to a
//   result    two parts: b with 3 shards and replicas a, c; a with 3 shards and replicas b, c
//
// If b then has more than 1.25 of its share of all parts under way, the least busy agent goes
// first.

#include "server/cluster/replica_board.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <functional>
#include <numeric>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/monotonic_time.h"
#include "core/base/random.h"

namespace isoscope::server {
namespace {

constexpr absl::Duration kFirstAvoidance = absl::Seconds(1);
constexpr absl::Duration kMaxAvoidance = absl::Seconds(30);

// An agent may have this many times its share of the parts that are under way.
constexpr double kMaxLoad = 1.25;

// FNV-1a, mixed: the same in every process, unlike std::hash.
std::uint64_t HashOf(absl::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char c : text) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  }
  return base::Mix64(hash);
}

std::uint64_t RankOf(std::uint64_t key, int shard, absl::string_view address) {
  return base::Mix64(base::Mix64(key ^ static_cast<std::uint64_t>(shard)) ^ HashOf(address));
}

// Returns the indices of the set's agents for a shard: agents without trouble first, then by rank.
std::vector<std::size_t> OrderOf(const ReplicaSet& set, const std::vector<bool>& is_well,
                                 std::uint64_t key, int shard) {
  std::vector<std::uint64_t> ranks;
  ranks.reserve(set.agents.size());
  for (const ServingAgent& agent : set.agents) {
    ranks.push_back(RankOf(key, shard, agent.address));
  }
  std::vector<std::size_t> order(set.agents.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return is_well[a] != is_well[b] ? is_well[a] : ranks[a] > ranks[b];
  });
  return order;
}

}  // namespace

std::string ReplicaKeyOf(absl::string_view dataset_id, std::vector<volume::InsideRule> rules) {
  std::sort(rules.begin(), rules.end());
  return absl::StrCat(dataset_id, "/",
                      absl::StrJoin(rules, ",", [](std::string* out, const auto& rule) {
                        absl::StrAppendFormat(out, "%.17g", rule.isovalue);
                        for (const double label : rule.labels) {
                          absl::StrAppend(out, "|", absl::Hex(std::bit_cast<std::uint64_t>(label)));
                        }
                      }));
}

std::vector<int> MissingShards(int shard_count, const std::vector<FramePart>& parts) {
  std::set<int> served;
  for (const FramePart& part : parts) {
    served.insert(part.shard_indices.begin(), part.shard_indices.end());
  }
  std::vector<int> missing;
  for (int shard = 0; shard < shard_count; ++shard) {
    if (served.count(shard) == 0) {
      missing.push_back(shard);
    }
  }
  return missing;
}

std::vector<FramePart> ReplicaBoard::Choose(const std::vector<ReplicaSet>& sets,
                                            absl::string_view key, base::MonotonicTime now) const {
  const std::uint64_t hash = HashOf(key);
  std::vector<FramePart> parts;
  const base::MutexLock lock(&mutex_);
  for (const ReplicaSet& set : sets) {
    if (set.agents.size() == 1) {
      parts.push_back({set.shard_indices, set.agents});
      continue;
    }
    std::vector<bool> is_well;
    for (const ServingAgent& agent : set.agents) {
      is_well.push_back(IsWell(agent.address, now));
    }
    const auto well_count =
        static_cast<std::size_t>(std::count(is_well.begin(), is_well.end(), true));
    const std::size_t chosen_from = well_count > 0 ? well_count : set.agents.size();
    const std::size_t share = (set.shard_indices.size() + chosen_from - 1) / chosen_from;
    constexpr std::size_t kNone = ~std::size_t{0};
    std::vector<std::size_t> part_of(set.agents.size(), kNone);
    for (const int shard : set.shard_indices) {
      const std::vector<std::size_t> order = OrderOf(set, is_well, hash, shard);
      const std::size_t agent = *std::find_if(order.begin(), order.end(), [&](std::size_t i) {
        return part_of[i] == kNone || parts[part_of[i]].shard_indices.size() < share;
      });
      if (part_of[agent] == kNone) {
        part_of[agent] = parts.size();
        FramePart part;
        part.replicas.push_back(set.agents[agent]);
        for (const std::size_t other : order) {
          if (other != agent) {
            part.replicas.push_back(set.agents[other]);
          }
        }
        PutIdlestFirst(&part.replicas, now);
        parts.push_back(std::move(part));
      }
      parts[part_of[agent]].shard_indices.push_back(shard);
    }
  }
  std::sort(parts.begin(), parts.end(), [](const FramePart& a, const FramePart& b) {
    return a.shard_indices.front() < b.shard_indices.front();
  });
  return parts;
}

void ReplicaBoard::PutIdlestFirst(std::vector<ServingAgent>* replicas,
                                  base::MonotonicTime now) const {
  int sum = 1;  // with this part
  for (const ServingAgent& agent : *replicas) {
    sum += PartCountOf(agent.address);
  }
  const double limit = kMaxLoad * sum / static_cast<double>(replicas->size());
  if (PartCountOf(replicas->front().address) < std::max(limit, 1.0)) {
    return;
  }
  const auto idlest = std::min_element(
      replicas->begin(), replicas->end(),
      [&](const ServingAgent& a, const ServingAgent& b) ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        const bool is_a_well = IsWell(a.address, now);
        const bool is_b_well = IsWell(b.address, now);
        return is_a_well != is_b_well ? is_a_well : PartCountOf(a.address) < PartCountOf(b.address);
      });
  std::rotate(replicas->begin(), idlest, idlest + 1);
}

ReplicaBoard::Lease ReplicaBoard::Take(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  hedges_ = std::min(hedges_ + kMaxHedgedShare, kMaxHedgeBurst);
  ++agents_[address].part_count;
  return {this, address};
}

void ReplicaBoard::Return(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  const auto found = agents_.find(address);
  --found->second.part_count;
  if (found->second.part_count == 0 && found->second.avoidance == absl::ZeroDuration()) {
    agents_.erase(found);
  }
}

bool ReplicaBoard::TryHedge(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  constexpr double kRounding = 1e-9;  // a whole attempt is a sum of many shares
  if (PartCountOf(address) > 0 || hedges_ < 1 - kRounding) {
    return false;
  }
  hedges_ = std::max(hedges_ - 1, 0.0);
  return true;
}

void ReplicaBoard::NoteTrouble(const std::string& address, base::MonotonicTime now) {
  const base::MutexLock lock(&mutex_);
  Agent& agent = agents_[address];
  agent.avoidance = agent.avoidance == absl::ZeroDuration()
                        ? kFirstAvoidance
                        : std::min(2 * agent.avoidance, kMaxAvoidance);
  agent.avoided_until = now + agent.avoidance;
}

void ReplicaBoard::NoteUnanswered(const std::string& address, absl::Duration waited,
                                  base::MonotonicTime now) {
  if (waited >= kLateAfter) {
    NoteTrouble(address, now);
  }
}

void ReplicaBoard::NoteSuccess(const std::string& address) {
  const base::MutexLock lock(&mutex_);
  const auto found = agents_.find(address);
  if (found == agents_.end()) {
    return;
  }
  found->second.avoidance = absl::ZeroDuration();
  found->second.avoided_until = base::MonotonicTime::InfinitePast();
  if (found->second.part_count == 0) {
    agents_.erase(found);
  }
}

bool ReplicaBoard::IsWell(const std::string& address, base::MonotonicTime now) const {
  const auto found = agents_.find(address);
  return found == agents_.end() || now >= found->second.avoided_until;
}

int ReplicaBoard::PartCountOf(const std::string& address) const {
  const auto found = agents_.find(address);
  return found == agents_.end() ? 0 : found->second.part_count;
}

}  // namespace isoscope::server
