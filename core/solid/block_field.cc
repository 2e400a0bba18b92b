#include "core/solid/block_field.h"

#include <cmath>

#include "core/base/coding.h"
#include "core/volume/scalar_type.h"

namespace isoscope::solid {

void BlockField::Set(const volume::BlockSamples& samples, const volume::InsideRule& rule) {
  rule_ = &rule;
  samples_ = samples;
  stored_ = layout_.StoredSamplesOf(samples.block_id);
  cells_ = layout_.CellsOf(samples.block_id);
  const math::Index3 dims = stored_.dims();
  strides_ = {1, static_cast<std::size_t>(dims.x), static_cast<std::size_t>(dims.x * dims.y)};
  states_.resize(static_cast<std::size_t>(math::Volume(dims)));
  has_missing_ = false;
  has_inside_ = false;
  volume::VisitScalarType(samples.type, [&]<typename T>() {
    for (std::size_t i = 0; i < states_.size(); ++i) {
      const auto value =
          static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + i * sizeof(T)));
      if (std::isnan(value)) {
        states_[i] = SampleState::kMissing;
        has_missing_ = true;
        continue;
      }
      const bool is_inside = rule.IsInside(value);
      states_[i] = is_inside ? SampleState::kInside : SampleState::kOutside;
      has_inside_ = has_inside_ || is_inside;
    }
  });
}

bool BlockField::touches_border() const {
  const math::Index3& dims = layout_.sample_dims();
  for (int axis = 0; axis < 3; ++axis) {
    if (cells_.begin[axis] == 0 || cells_.end[axis] == dims[axis] - 1) {
      return true;
    }
  }
  return false;
}

SampleIndex BlockField::IndexOf(const math::Index3& position) const {
  const math::Index3 local = position - stored_.begin;
  return static_cast<std::size_t>(local.x) + strides_[1] * static_cast<std::size_t>(local.y) +
         strides_[2] * static_cast<std::size_t>(local.z);
}

math::Index3 BlockField::PositionOf(SampleIndex sample) const {
  const std::size_t in_slice = sample % strides_[2];
  return stored_.begin + math::Index3{static_cast<std::int64_t>(in_slice % strides_[1]),
                                      static_cast<std::int64_t>(in_slice / strides_[1]),
                                      static_cast<std::int64_t>(sample / strides_[2])};
}

std::int64_t BlockField::LinearInVolume(SampleIndex sample) const {
  const math::Index3& dims = layout_.sample_dims();
  const math::Index3 position = PositionOf(sample);
  return position.x + dims.x * (position.y + dims.y * position.z);
}

std::size_t BlockField::LocalEdge(std::int64_t key) const {
  const math::Index3& dims = layout_.sample_dims();
  const std::int64_t lower = key / 3;
  return 3 * IndexOf({lower % dims.x, lower / dims.x % dims.y, lower / (dims.x * dims.y)}) +
         static_cast<std::size_t>(key % 3);
}

double BlockField::ValueAt(SampleIndex sample) const {
  return volume::VisitScalarType(samples_.type, [&]<typename T>() {
    return static_cast<double>(base::LoadLittleEndian<T>(samples_.bytes + sample * sizeof(T)));
  });
}

CellState BlockField::StateOfCell(const math::Index3& cell) const {
  const math::Index3& dims = layout_.sample_dims();
  for (int axis = 0; axis < 3; ++axis) {
    if (cell[axis] < 0 || cell[axis] + 1 >= dims[axis]) {
      return CellState::kAbsent;
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (cell[axis] < stored_.begin[axis] || cell[axis] + 1 >= stored_.end[axis]) {
      return CellState::kUnknown;
    }
  }
  if (!has_missing_) {
    return CellState::kPresent;
  }
  const SampleIndex lowest = IndexOf(cell);
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const SampleIndex sample =
        lowest + (corner & 1) + strides_[1] * (corner >> 1 & 1) + strides_[2] * (corner >> 2);
    if (states_[sample] == SampleState::kMissing) {
      return CellState::kAbsent;
    }
  }
  return CellState::kPresent;
}

unsigned BlockField::CaseOf(SampleIndex cell) const {
  unsigned inside = 0;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const SampleIndex sample =
        cell + (corner & 1) + strides_[1] * (corner >> 1 & 1) + strides_[2] * (corner >> 2);
    inside |= states_[sample] == SampleState::kInside ? 1U << corner : 0U;
  }
  return inside;
}

}  // namespace isoscope::solid
