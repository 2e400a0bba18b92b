#include "core/solid/surface_fans.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>

#include "core/base/check.h"

namespace isoscope::solid {

void SurfaceFans::Begin() {
  fans_.clear();
  fan_of_corner_.clear();
  plain_.clear();
  fans_at_.clear();
}

bool SurfaceFans::IsPlain(VertexId vertex) {
  if (vertex >= plain_.size()) {
    plain_.resize(vertex + 1, 0);
  }
  if (plain_[vertex] != 0) {
    return plain_[vertex] == 1;
  }
  const std::uint32_t edge = pool_.EdgeOf(vertex);
  // A vertex at a sample may share its position with those of other edges.
  bool is_plain = edge != VertexPool::kNoEdge;
  if (is_plain) {
    const float coordinate = pool_[vertex].position[static_cast<int>(edge % 3)];
    is_plain = coordinate != std::floor(coordinate);
  }
  if (is_plain) {
    const math::Index3 lower = field_.PositionOf(edge / 3);
    const int u = static_cast<int>(edge % 3 + 1) % 3;
    const int v = static_cast<int>(edge % 3 + 2) % 3;
    for (int i = 0; i < 4 && is_plain; ++i) {
      math::Index3 cell = lower;
      cell[u] -= i % 2;
      cell[v] -= i / 2;
      is_plain = field_.StateOfCell(cell) != CellState::kPresent || !complex_.IsSpecial(cell);
    }
  }
  plain_[vertex] = is_plain ? 1 : 2;
  return is_plain;
}

SurfaceFans::Rank SurfaceFans::EdgeRankOf(PartId part) {
  const PartId partner = seams_.PartnerOf(part);
  return partner == Seams::kOpen ? seams_.RankOf(part)
                                 : std::min(seams_.RankOf(part), seams_.RankOf(partner));
}

FanId SurfaceFans::FanOf(PartId corner) {
  if (const auto found = fan_of_corner_.find(corner); found != fan_of_corner_.end()) {
    return found->second;
  }
  Fan fan;
  fan.corners.push_back(corner);
  while (true) {
    const PartId partner = seams_.PartnerOf(fan.corners.back());
    if (partner == Seams::kOpen) {
      break;
    }
    const PartId next = seams_.NextOf(partner);
    if (next == corner) {
      fan.is_closed = true;
      break;
    }
    fan.corners.push_back(next);
  }
  if (!fan.is_closed) {
    // The rest of the fan, on the other side.
    std::vector<PartId> before;
    for (PartId partner = seams_.PartnerOf(seams_.BeforeOf(corner)); partner != Seams::kOpen;
         partner = seams_.PartnerOf(seams_.BeforeOf(partner))) {
      before.push_back(partner);
    }
    fan.corners.insert(fan.corners.begin(), before.rbegin(), before.rend());
  }
  fan.first = *std::min_element(fan.corners.begin(), fan.corners.end(), [this](PartId a, PartId b) {
    return seams_.RankOf(a) < seams_.RankOf(b);
  });
  const auto id = static_cast<FanId>(fans_.size());
  for (const PartId one : fan.corners) {
    fan_of_corner_[one] = id;
  }
  fans_.push_back(std::move(fan));
  return id;
}

math::Vec3f SurfaceFans::PositionOf(FanId fan) {
  return pool_[seams_.VertexOf(fans_[fan].first)].position;
}

std::vector<math::Index3> SurfaceFans::CellsAt(const math::Vec3f& position) const {
  std::array<std::array<std::int64_t, 2>, 3> ranges{};
  for (int axis = 0; axis < 3; ++axis) {
    const float below = std::floor(position[axis]);
    const auto cell = static_cast<std::int64_t>(below);
    ranges[static_cast<std::size_t>(axis)] = {below == position[axis] ? cell - 1 : cell, cell};
  }
  std::vector<math::Index3> cells;
  for (std::int64_t z = ranges[2][0]; z <= ranges[2][1]; ++z) {
    for (std::int64_t y = ranges[1][0]; y <= ranges[1][1]; ++y) {
      for (std::int64_t x = ranges[0][0]; x <= ranges[0][1]; ++x) {
        if (field_.StateOfCell({x, y, z}) == CellState::kPresent) {
          cells.push_back({x, y, z});
        }
      }
    }
  }
  return cells;
}

const std::vector<FanId>& SurfaceFans::FansAt(math::Vec3f position) {
  const Position key{position.x + 0.0F, position.y + 0.0F, position.z + 0.0F};
  if (const auto found = fans_at_.find(key); found != fans_at_.end()) {
    return found->second;
  }
  std::vector<FanId> fans;
  for (const math::Index3& cell : CellsAt(position)) {
    const SolidComplex::PieceRange pieces = complex_.PiecesOf(cell);
    for (PieceId piece = pieces.begin; piece < pieces.end; ++piece) {
      if (seams_.IsDropped(piece)) {
        continue;
      }
      const PartId first = FirstPartOf(IdOf(piece, 0));
      PartId corner = first;
      do {
        if (pool_[seams_.VertexOf(corner)].position == position) {
          const FanId fan = FanOf(corner);
          if (PositionOf(fan) == position) {
            fans.push_back(fan);
          }
        }
        corner = seams_.NextOf(corner);
      } while (corner != first);
    }
  }
  std::sort(fans.begin(), fans.end());
  fans.erase(std::unique(fans.begin(), fans.end()), fans.end());
  std::sort(fans.begin(), fans.end(), [this](FanId a, FanId b) {
    return seams_.RankOf(fans_[a].first) < seams_.RankOf(fans_[b].first);
  });
  ISOSCOPE_CHECK_LT(fans.size(), std::size_t{kFirstMiddle});
  for (std::size_t i = 0; i < fans.size(); ++i) {
    fans_[fans[i]].copy = static_cast<int>(i);
  }
  return fans_at_.emplace(key, std::move(fans)).first->second;
}

std::uint8_t SurfaceFans::CopyOf(FanId fan) {
  if (fans_[fan].copy < 0) {
    FansAt(PositionOf(fan));
  }
  ISOSCOPE_CHECK_GE(fans_[fan].copy, 0);
  return static_cast<std::uint8_t>(fans_[fan].copy);
}

SurfaceFans::Final SurfaceFans::FinalOf(PartId corner) {
  const VertexId vertex = seams_.VertexOf(corner);
  return IsPlain(vertex) ? Final{0, vertex} : Final{1, FanOf(corner)};
}

std::vector<std::pair<PartId, PartId>> SurfaceFans::SpokesOf(FanId fan) {
  std::vector<std::pair<PartId, PartId>> spokes;
  for (const PartId corner : fans_[fan].corners) {
    spokes.emplace_back(corner, seams_.NextOf(corner));
  }
  if (!fans_[fan].is_closed) {
    const PartId last = seams_.BeforeOf(fans_[fan].corners.front());
    spokes.emplace_back(last, last);
  }
  return spokes;
}

std::optional<std::uint8_t> SurfaceFans::MiddleOf(PartId part) {
  const PartId from = part;
  const PartId to = seams_.NextOf(part);
  const bool is_from_plain = IsPlain(seams_.VertexOf(from));
  const bool is_to_plain = IsPlain(seams_.VertexOf(to));
  if (is_from_plain && is_to_plain) {
    return std::nullopt;
  }
  // Both pieces of the part, and all blocks, look from the same end.
  const auto place_of = [this](PartId corner) { return pool_[seams_.VertexOf(corner)].place; };
  const auto is_lower = [](const math::Vec3d& a, const math::Vec3d& b) {
    return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
  };
  const bool looks_from_start =
      is_to_plain || (!is_from_plain && is_lower(place_of(from), place_of(to)));
  const math::Vec3d far_place = place_of(looks_from_start ? to : from);
  const FanId near_fan = FanOf(looks_from_start ? from : to);
  const std::vector<std::pair<PartId, PartId>> own_spokes = SpokesOf(near_fan);
  if (std::count_if(own_spokes.begin(), own_spokes.end(),
                    [&](const auto& spoke) { return place_of(spoke.second) == far_place; }) < 2) {
    return std::nullopt;
  }
  const std::vector<Rank> later = LaterEdges(PositionOf(near_fan), far_place);
  const auto found = std::find(later.begin(), later.end(), EdgeRankOf(part));
  if (found == later.end()) {
    return std::nullopt;
  }
  const auto index = found - later.begin();
  ISOSCOPE_CHECK_LT(index, kFirstCenter - kFirstMiddle);
  return static_cast<std::uint8_t>(kFirstMiddle + index);
}

bool SurfaceFans::MeetElsewhere(PartId a, PartId b) {
  const bool is_a_plain = IsPlain(seams_.VertexOf(a));
  const Final far = FinalOf(is_a_plain ? a : b);
  const PieceId own = PieceOf(SideOfPart(a));
  const std::vector<PartId> corners = fans_[FanOf(is_a_plain ? b : a)].corners;
  return std::any_of(corners.begin(), corners.end(), [&](PartId corner) {
    if (PieceOf(SideOfPart(corner)) == own) {
      return false;
    }
    for (PartId at = seams_.NextOf(corner); at != corner; at = seams_.NextOf(at)) {
      if (FinalOf(at) == far) {
        return true;
      }
    }
    return false;
  });
}

math::Vec3d SurfaceFans::TriplePlaceOf(PieceId piece) {
  const Corners& corners = complex_.piece(piece).corners;
  std::array<math::Vec3d, 3> places{pool_[corners[0]].place, pool_[corners[1]].place,
                                    pool_[corners[2]].place};
  std::sort(places.begin(), places.end(), [](const math::Vec3d& a, const math::Vec3d& b) {
    return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
  });
  return places[0] + places[1] + places[2];
}

std::uint8_t SurfaceFans::CenterOf(PartId corner) {
  const PieceId own = PieceOf(SideOfPart(corner));
  const math::Vec3d center = TriplePlaceOf(own);
  std::vector<Rank> ranks;
  for (const FanId fan : FansAt(PositionOf(FanOf(corner)))) {
    for (const PartId other : fans_[fan].corners) {
      const PieceId piece = PieceOf(SideOfPart(other));
      if (TriplePlaceOf(piece) == center) {
        ranks.push_back(seams_.RankOf(FirstPartOf(IdOf(piece, 0))));
      }
    }
  }
  std::sort(ranks.begin(), ranks.end());
  ranks.erase(std::unique(ranks.begin(), ranks.end()), ranks.end());
  const auto index =
      std::find(ranks.begin(), ranks.end(), seams_.RankOf(FirstPartOf(IdOf(own, 0)))) -
      ranks.begin();
  ISOSCOPE_CHECK_LT(index, 256 - kFirstCenter);
  return static_cast<std::uint8_t>(kFirstCenter + index);
}

std::vector<SurfaceFans::Rank> SurfaceFans::LaterEdges(const math::Vec3f& near,
                                                       const math::Vec3d& far) {
  std::vector<std::tuple<FanId, Final, Rank>> edges;
  for (const FanId fan : FansAt(near)) {
    for (const auto& [spoke, corner] : SpokesOf(fan)) {
      if (pool_[seams_.VertexOf(corner)].place == far) {
        edges.emplace_back(fan, FinalOf(corner), EdgeRankOf(spoke));
      }
    }
  }
  std::sort(edges.begin(), edges.end());
  std::vector<Rank> later;
  for (std::size_t i = 1; i < edges.size(); ++i) {
    if (std::get<0>(edges[i]) == std::get<0>(edges[i - 1]) &&
        std::get<1>(edges[i]) == std::get<1>(edges[i - 1])) {
      later.push_back(std::get<2>(edges[i]));
    }
  }
  std::sort(later.begin(), later.end());
  return later;
}

}  // namespace isoscope::solid
