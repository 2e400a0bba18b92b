// Drop finds the needles that are joined, and the loops of sides around them. Zip joins the steps
// of a loop:
//
//   1. Places of all corners are put in their order on the line, and each side of the loop is split
//      into steps between neighbouring places.
//   2. Steps go on a stack. A step that goes back along the one on top is joined with it, and both
//      are gone. A walk along a line that ends where it began leaves nothing.
//
// Example: the loop a b, b m, m a of a needle has places a m b, and steps am mb bm ma. The third
// goes back along the second, the fourth along the first.

#include "core/solid/seams.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "core/base/check.h"

namespace isoscope::solid {
namespace {

constexpr std::size_t kMaxParts = 64;

}  // namespace

void Seams::Begin() {
  states_.clear();
  splits_.clear();
}

Seams::Rank Seams::RankOf(PartId part) const {
  const SideId side = SideOfPart(part);
  const Piece& piece = complex_.piece(PieceOf(side));
  return {field_.LinearInVolume(field_.IndexOf(complex_.CellOf(PieceOf(side)))), piece.tag,
          piece.index, NumberOf(side), NumberOfPart(part)};
}

bool Seams::IsDropped(PieceId piece) {
  if (complex_.IsFlat(piece)) {
    return true;
  }
  if (piece >= states_.size()) {
    states_.resize(piece + 1, State::kUnasked);
  }
  if (states_[piece] == State::kUnasked) {
    if (complex_.IsNeedle(piece)) {
      Drop(piece);
    } else {
      states_[piece] = State::kKept;
    }
  }
  return states_[piece] == State::kDropped;
}

void Seams::Drop(PieceId needle) {
  std::vector<PieceId> needles{needle};
  const auto has = [&](PieceId piece) {
    return std::find(needles.begin(), needles.end(), piece) != needles.end();
  };
  std::vector<SideId> border;
  for (std::size_t i = 0; i < needles.size(); ++i) {
    for (std::size_t number = 0; number < 3; ++number) {
      const SideId side = IdOf(needles[i], number);
      const SideId partner = complex_.PartnerOf(side);
      if (partner == SolidComplex::kOpen || !complex_.IsNeedle(PieceOf(partner))) {
        border.push_back(side);
      } else if (!has(PieceOf(partner))) {
        needles.push_back(PieceOf(partner));
      }
    }
  }
  const auto by_rank = [this](std::uint32_t a, std::uint32_t b) {
    return RankOf(FirstPartOf(a)) < RankOf(FirstPartOf(b));
  };
  std::vector<CornerId> corners;
  for (const PieceId piece : needles) {
    if (piece >= states_.size()) {
      states_.resize(piece + 1, State::kUnasked);
    }
    states_[piece] = State::kDropped;
    for (std::size_t number = 0; number < 3; ++number) {
      corners.push_back(IdOf(piece, number));
    }
  }
  std::sort(corners.begin(), corners.end(), by_rank);
  std::sort(border.begin(), border.end(), by_rank);
  while (!border.empty()) {
    std::vector<SideId> loop;
    SideId side = border.front();
    do {
      loop.push_back(side);
      border.erase(std::find(border.begin(), border.end(), side));
      // The next side of the border begins at this one's end: turn around it, within the needles.
      side = IdOf(PieceOf(side), NumberOf(side) + 1);
      for (SideId partner = complex_.PartnerOf(side);
           partner != SolidComplex::kOpen && complex_.IsNeedle(PieceOf(partner));
           partner = complex_.PartnerOf(side)) {
        side = IdOf(PieceOf(partner), NumberOf(partner) + 1);
      }
    } while (side != loop.front());
    Zip(loop, corners);
  }
}

void Seams::Zip(const std::vector<SideId>& loop, const std::vector<CornerId>& corners) {
  const auto place_of = [this](CornerId corner) -> const math::Vec3d& {
    return pool_[complex_.VertexOf(corner)].place;
  };
  // Step 1: the places on the line, each with the corner of the lowest rank there.
  const math::Vec3d origin = place_of(loop.front());
  math::Vec3d direction;
  for (const CornerId corner : loop) {
    const math::Vec3d way = place_of(corner) - origin;
    if (math::Dot(way, way) > math::Dot(direction, direction)) {
      direction = way;
    }
  }
  std::vector<std::pair<double, CornerId>> places;
  for (const CornerId corner : corners) {
    const bool is_known = std::any_of(places.begin(), places.end(), [&](const auto& known) {
      return place_of(known.second) == place_of(corner);
    });
    const bool is_in_loop = std::any_of(loop.begin(), loop.end(), [&](CornerId in_loop) {
      return place_of(in_loop) == place_of(corner);
    });
    if (!is_known && is_in_loop) {
      places.emplace_back(math::Dot(place_of(corner) - origin, direction), corner);
    }
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  const auto index_of = [&](CornerId corner) {
    const auto found = std::find_if(places.begin(), places.end(), [&](const auto& place) {
      return place_of(place.second) == place_of(corner);
    });
    return static_cast<std::size_t>(found - places.begin());
  };
  // Step 2.
  std::vector<SideId> outsides;
  std::vector<Step> steps;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const std::size_t from = index_of(loop[i]);
    const std::size_t to = index_of(IdOf(PieceOf(loop[i]), NumberOf(loop[i]) + 1));
    const std::size_t count = from < to ? to - from : from - to;
    ISOSCOPE_CHECK_LT(count, kMaxParts);
    const SideId outside = complex_.PartnerOf(loop[i]);
    outsides.push_back(outside);
    if (outside != SolidComplex::kOpen) {
      Split& split = splits_[outside];
      split.partners.assign(count, kOpen);
      split.inner.clear();
      for (std::size_t k = 1; k < count; ++k) {  // against the needle's side
        split.inner.push_back(complex_.VertexOf(places[from < to ? to - k : to + k].second));
      }
    }
    for (std::size_t k = 0; k < count; ++k) {
      steps.push_back({.from = from < to ? from + k : from - k,
                       .to = from < to ? from + k + 1 : from - k - 1,
                       .border = i,
                       .number = count - 1 - k});
    }
  }
  std::vector<Step> stack;
  for (const Step& step : steps) {
    if (stack.empty() || stack.back().from != step.to || stack.back().to != step.from) {
      stack.push_back(step);
      continue;
    }
    const Step other = stack.back();
    stack.pop_back();
    const SideId a = outsides[step.border];
    const SideId b = outsides[other.border];
    if (a != SolidComplex::kOpen && b != SolidComplex::kOpen) {
      splits_[a].partners[step.number] = FirstPartOf(b) + other.number;
      splits_[b].partners[other.number] = FirstPartOf(a) + step.number;
    }
  }
  ISOSCOPE_CHECK(stack.empty());
}

const Seams::Split* Seams::SplitOf(SideId side) {
  const SideId partner = complex_.PartnerOf(side);
  if (partner == SolidComplex::kOpen || !IsDropped(PieceOf(partner))) {
    return nullptr;
  }
  return &splits_.at(side);
}

std::size_t Seams::PartCountOf(SideId side) {
  const Split* const split = SplitOf(side);
  return split == nullptr ? 1 : split->partners.size();
}

VertexId Seams::VertexOf(PartId part) {
  const SideId side = SideOfPart(part);
  const std::size_t number = NumberOfPart(part);
  return number == 0 ? complex_.VertexOf(side) : SplitOf(side)->inner[number - 1];
}

PartId Seams::PartnerOf(PartId part) {
  const SideId side = SideOfPart(part);
  if (const Split* const split = SplitOf(side); split != nullptr) {
    return split->partners[NumberOfPart(part)];
  }
  const SideId partner = complex_.PartnerOf(side);
  return partner == SolidComplex::kOpen ? kOpen : FirstPartOf(partner);
}

PartId Seams::NextOf(PartId part) {
  const SideId side = SideOfPart(part);
  return NumberOfPart(part) + 1 < PartCountOf(side)
             ? part + 1
             : FirstPartOf(IdOf(PieceOf(side), NumberOf(side) + 1));
}

PartId Seams::BeforeOf(PartId part) {
  if (NumberOfPart(part) > 0) {
    return part - 1;
  }
  const SideId side = SideOfPart(part);
  const SideId before = IdOf(PieceOf(side), NumberOf(side) + 2);
  return FirstPartOf(before) + PartCountOf(before) - 1;
}

}  // namespace isoscope::solid
