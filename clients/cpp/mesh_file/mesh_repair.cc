// 1. FindCrowdedEdges sorts the sides of all triangles. A crowded edge has two sides or more in one
//    direction.
// 2. FinOpener looks for fins: two triangles on the same three vertices, back to back, that hang on
//    a crowded edge. Parts that are simplified each by itself make them of a vertex of their border
//    and the edge between its neighbours. The vertex goes back into that edge.
// 3. Separator looks at the triangles at the ends of such edges. Each side there gets a partner,
//    which runs against it. Around an end, triangles whose sides are partners are one fan. Each fan
//    but the first gets a vertex of its own.
// 4. Edges that are still crowded join the same two fans several times: all but one of these get a
//    vertex in the middle, and two triangles of each of theirs.
//
// Example: two tetrahedra that share an edge a b have four triangles on it. Partners are those of
// one tetrahedron; a and b have two fans each, so both become two vertices.

#include "clients/cpp/mesh_file/mesh_repair.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"

#include "core/base/status_macros.h"
#include "core/io/file_array.h"
#include "core/math/vec.h"

namespace isoscope::client {
namespace {

using Edge = std::pair<std::uint32_t, std::uint32_t>;  // the lower vertex first
// 3 * triangle + i: the side from corner i to corner i + 1, or corner i.
using SideIndex = std::size_t;
constexpr SideIndex kNoSide = ~SideIndex{0};

SideIndex NextSide(SideIndex side) { return side % 3 == 2 ? side - 2 : side + 1; }
SideIndex SideBefore(SideIndex side) { return side % 3 == 0 ? side + 2 : side - 1; }

std::uint64_t DirectedKey(std::uint32_t from, std::uint32_t to) {
  return std::uint64_t{from} << 32 | to;
}

absl::StatusOr<std::vector<Edge>> FindCrowdedEdges(MeshStore* mesh) {
  const std::span<const std::uint32_t> triangles = mesh->triangles().values();
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint64_t> sides,
                            io::FileArray<std::uint64_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(sides.Resize(triangles.size()));
  std::uint64_t* const data = sides.data();
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    data[i] = DirectedKey(triangles[i], triangles[NextSide(i)]);
  }
  std::sort(data, data + triangles.size());
  std::vector<Edge> edges;
  for (std::size_t i = 1; i < triangles.size(); ++i) {
    if (data[i] == data[i - 1]) {
      edges.push_back(std::minmax(static_cast<std::uint32_t>(data[i] >> 32),
                                  static_cast<std::uint32_t>(data[i])));
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

// Step 2: of triangles low-high-apex, high-low-apex (the fin), low-high-c and high-low-d it makes
// low-apex-c, apex-high-c, high-apex-d and apex-low-d. Each takes one fin away and adds none.
class FinOpener {
 public:
  FinOpener(MeshStore* mesh, const std::vector<Edge>& edges) : mesh_(*mesh), edges_(edges) {
    absl::flat_hash_set<std::uint32_t> ends;
    for (const auto& [low, high] : edges_) {
      ends.insert(low);
      ends.insert(high);
    }
    const std::span<const std::uint32_t> triangles = mesh_.triangles().values();
    absl::flat_hash_set<std::uint32_t> seen = ends;  // and apexes
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      if (ends.contains(triangles[i]) && ends.contains(triangles[NextSide(i)])) {
        seen.insert(ApexOf(i));
      }
    }
    for (std::size_t i = 0; i < triangles.size(); i += 3) {
      if (seen.contains(triangles[i]) || seen.contains(triangles[i + 1]) ||
          seen.contains(triangles[i + 2])) {
        AddSides(i);
      }
    }
  }

  // Returns whether there was a fin. One may hang on another.
  bool Run() {
    bool has_opened = false;
    bool is_done = false;
    while (!is_done) {
      is_done = true;
      for (const Edge& edge : edges_) {
        if (Open(edge)) {
          has_opened = true;
          is_done = false;
        }
      }
    }
    return has_opened;
  }

 private:
  bool Open(const Edge& edge) {
    const auto [low, high] = edge;
    const std::vector<SideIndex> along = SidesOf(low, high);
    const std::vector<SideIndex> against = SidesOf(high, low);
    if (along.size() != 2 || against.size() != 2) {
      return false;
    }
    for (std::size_t i = 0; i < 2; ++i) {
      for (std::size_t k = 0; k < 2; ++k) {
        const std::uint32_t apex = ApexOf(along[i]);
        const std::uint32_t c = ApexOf(along[1 - i]);
        const std::uint32_t d = ApexOf(against[1 - k]);
        if (apex != ApexOf(against[k]) || c == d || c == apex || d == apex || HasEdge(apex, c) ||
            HasEdge(apex, d) || !IsBetween(apex, edge)) {
          continue;
        }
        Replace(along[1 - i], {low, apex, c});
        Replace(along[i], {apex, high, c});
        Replace(against[1 - k], {high, apex, d});
        Replace(against[k], {apex, low, d});
        return true;
      }
    }
    return false;
  }

  // Whether it lies in the ball around the edge's middle that has both ends on it. So the surface
  // moves by half an edge at most.
  [[nodiscard]] bool IsBetween(std::uint32_t vertex, const Edge& edge) const {
    return math::Dot(At(edge.first) - At(vertex), At(edge.second) - At(vertex)) <= 0;
  }
  [[nodiscard]] bool HasEdge(std::uint32_t a, std::uint32_t b) const {
    return !SidesOf(a, b).empty() || !SidesOf(b, a).empty();
  }

  void Replace(SideIndex side, const std::array<std::uint32_t, 3>& corners) {
    const std::size_t first = side - side % 3;
    std::uint32_t* const triangles = mesh_.triangles().data();
    for (const std::size_t k : {first, first + 1, first + 2}) {
      std::erase(sides_[DirectedKey(triangles[k], triangles[NextSide(k)])], k);
    }
    std::copy(corners.begin(), corners.end(), triangles + first);
    AddSides(first);
  }

  void AddSides(std::size_t first) {
    const std::span<const std::uint32_t> triangles = mesh_.triangles().values();
    for (const std::size_t side : {first, first + 1, first + 2}) {
      sides_[DirectedKey(triangles[side], triangles[NextSide(side)])].push_back(side);
    }
  }

  [[nodiscard]] std::vector<SideIndex> SidesOf(std::uint32_t from, std::uint32_t to) const {
    const auto found = sides_.find(DirectedKey(from, to));
    return found == sides_.end() ? std::vector<SideIndex>() : found->second;
  }
  [[nodiscard]] std::uint32_t ApexOf(SideIndex side) const {
    return mesh_.triangles().data()[SideBefore(side)];
  }
  [[nodiscard]] math::Vec3d At(std::uint32_t vertex) const {
    const float* const p = mesh_.positions().data() + 3 * std::size_t{vertex};
    return {double{p[0]}, double{p[1]}, double{p[2]}};
  }

  MeshStore& mesh_;
  const std::vector<Edge>& edges_;
  absl::flat_hash_map<std::uint64_t, std::vector<SideIndex>> sides_;  // by direction
};

// The triangles at the ends of crowded edges.
class Separator {
 public:
  Separator(MeshStore* mesh, const std::vector<Edge>& edges) : mesh_(*mesh) {
    for (const auto& [low, high] : edges) {
      ends_.insert(low);
      ends_.insert(high);
    }
    const std::span<const std::uint32_t> triangles = mesh_.triangles().values();
    for (std::size_t i = 0; i < triangles.size(); i += 3) {
      if (ends_.contains(triangles[i]) || ends_.contains(triangles[i + 1]) ||
          ends_.contains(triangles[i + 2])) {
        for (const std::size_t side : {i, i + 1, i + 2}) {
          sides_[DirectedKey(triangles[side], triangles[NextSide(side)])].push_back(side);
        }
      }
    }
    for (const auto& [key, sides] : sides_) {
      const auto against = sides_.find(key << 32 | key >> 32);
      const std::size_t count =
          against == sides_.end() ? 0 : std::min(sides.size(), against->second.size());
      for (std::size_t i = 0; i < count; ++i) {
        partners_[sides[i]] = against->second[i];
      }
    }
  }

  absl::Status Run() {
    ISOSCOPE_RETURN_IF_ERROR(SplitEnds());
    return SplitEdges();
  }

 private:
  [[nodiscard]] SideIndex PartnerOf(SideIndex side) const {
    const auto found = partners_.find(side);
    return found == partners_.end() ? kNoSide : found->second;
  }

  // Step 3.
  absl::Status SplitEnds() {
    absl::flat_hash_set<SideIndex> done;
    absl::flat_hash_set<std::uint32_t> kept;  // vertices whose first fan was seen
    std::vector<SideIndex> corners;
    const std::span<const std::uint32_t> triangles = mesh_.triangles().values();
    for (const auto& [key, sides] : sides_) {
      for (const SideIndex side : sides) {
        if (ends_.contains(triangles[side])) {
          corners.push_back(side);
        }
      }
    }
    std::sort(corners.begin(), corners.end());  // a hash map has no order
    for (const SideIndex corner : corners) {
      if (done.contains(corner)) {
        continue;
      }
      const std::vector<SideIndex> fan = FanOf(corner);
      done.insert(fan.begin(), fan.end());
      const std::uint32_t vertex = mesh_.triangles().data()[corner];
      if (kept.insert(vertex).second) {
        continue;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t copy, mesh_.AddMean({vertex}));
      for (const SideIndex fan_side : fan) {
        mesh_.triangles().data()[fan_side] = copy;
      }
    }
    return absl::OkStatus();
  }

  // The corners around a vertex that partners join to one.
  [[nodiscard]] std::vector<SideIndex> FanOf(SideIndex corner) const {
    std::vector<SideIndex> fan{corner};
    for (SideIndex partner = PartnerOf(corner); partner != kNoSide;
         partner = PartnerOf(fan.back())) {
      if (NextSide(partner) == corner) {
        return fan;
      }
      fan.push_back(NextSide(partner));
    }
    for (SideIndex partner = PartnerOf(SideBefore(corner)); partner != kNoSide;
         partner = PartnerOf(SideBefore(partner))) {
      fan.push_back(partner);
    }
    return fan;
  }

  // Step 4. Triangles are cut once: one that has two crowded edges left comes again.
  absl::Status SplitEdges() {
    constexpr int kMaxRounds = 64;
    for (int round = 0; round < kMaxRounds; ++round) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<Edge> edges, FindCrowdedEdges(&mesh_));
      if (edges.empty()) {
        return absl::OkStatus();
      }
      absl::flat_hash_map<Edge, std::vector<SideIndex>> sides;
      for (const Edge& edge : edges) {
        sides[edge] = {};
      }
      const std::span<const std::uint32_t> triangles = mesh_.triangles().values();
      for (std::size_t i = 0; i < triangles.size(); ++i) {
        const auto found = sides.find(std::minmax(triangles[i], triangles[NextSide(i)]));
        if (found != sides.end()) {
          found->second.push_back(i);
        }
      }
      absl::flat_hash_set<std::size_t> cut;
      bool has_cut = false;
      for (const Edge& edge : edges) {
        ISOSCOPE_ASSIGN_OR_RETURN(const bool was_cut, SplitEdge(edge, sides[edge], &cut));
        has_cut = has_cut || was_cut;
      }
      if (!has_cut) {  // sides of one direction alone
        break;
      }
    }
    return absl::OkStatus();
  }

  // Gives a pair of sides of the edge a vertex in their middle. False if there is no pair whose
  // triangles are uncut.
  absl::StatusOr<bool> SplitEdge(const Edge& edge, const std::vector<SideIndex>& sides,
                                 absl::flat_hash_set<std::size_t>* cut) {
    const auto is_free = [&](SideIndex side, bool forward) {
      return (mesh_.triangles().data()[side] == edge.first) == forward && !cut->contains(side / 3);
    };
    const auto a = std::find_if(sides.begin(), sides.end(),
                                [&](SideIndex side) { return is_free(side, true); });
    auto b = a == sides.end() ? a : std::find(sides.begin(), sides.end(), PartnerOf(*a));
    const auto apex_of = [&](SideIndex side) { return mesh_.triangles().data()[SideBefore(side)]; };
    // Two triangles of one apex would have a crowded edge again.
    if (b == sides.end() || !is_free(*b, false)) {
      b = std::find_if(sides.begin(), sides.end(), [&](SideIndex side) {
        return is_free(side, false) && apex_of(side) != apex_of(*a);
      });
    }
    if (b == sides.end()) {
      b = std::find_if(sides.begin(), sides.end(),
                       [&](SideIndex side) { return is_free(side, false); });
    }
    if (a == sides.end() || b == sides.end() || *a / 3 == *b / 3) {
      return false;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t middle, mesh_.AddMean({edge.first, edge.second}));
    for (const SideIndex side : {*a, *b}) {
      std::uint32_t* const triangles = mesh_.triangles().data();
      const std::uint32_t to = triangles[NextSide(side)];
      const std::uint32_t apex = triangles[SideBefore(side)];
      triangles[NextSide(side)] = middle;
      cut->insert(side / 3);
      ISOSCOPE_RETURN_IF_ERROR(
          mesh_.triangles().Append(std::vector<std::uint32_t>{middle, to, apex}));
    }
    return true;
  }

  MeshStore& mesh_;
  absl::flat_hash_set<std::uint32_t> ends_;
  absl::flat_hash_map<std::uint64_t, std::vector<SideIndex>> sides_;  // by direction, ascending
  absl::flat_hash_map<SideIndex, SideIndex> partners_;
};

}  // namespace

absl::StatusOr<std::int64_t> SeparateTouchingParts(MeshStore* mesh) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<Edge> edges, FindCrowdedEdges(mesh));
  const auto count = static_cast<std::int64_t>(edges.size());
  if (!edges.empty() && FinOpener(mesh, edges).Run()) {
    ISOSCOPE_ASSIGN_OR_RETURN(edges, FindCrowdedEdges(mesh));
  }
  if (!edges.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(Separator(mesh, edges).Run());
  }
  return count;
}

}  // namespace isoscope::client
