#include "core/extract/block_extractor.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <type_traits>
#include <vector>

#include "core/base/check.h"
#include "core/extract/block_shape.h"
#include "core/extract/case_table.h"
#include "core/volume/scalar_span.h"

namespace isoscope::extract {
namespace {

using math::Index3;
using math::Vec3d;
using math::Vec3f;

template <typename T>
T LoadSample(const char* bytes, std::size_t index) {
  T value;
  std::memcpy(&value, bytes + index * sizeof(T), sizeof(T));
  return value;
}

// Bits [64 word + offset, 64 word + offset + 64) of `bits`.
inline std::uint64_t Shifted(const std::uint64_t* bits, std::size_t word, std::size_t offset) {
  const std::uint64_t* at = bits + word + offset / 64;
  const std::size_t shift = offset % 64;
  return at[0] >> shift | at[1] << 1 << (63 - shift);
}

// Packs 64 bytes of 0 or 1 into a word, the first one lowest.
inline std::uint64_t PackBits(const std::uint8_t* flags) {
  std::uint64_t word = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    std::uint64_t eight;
    std::memcpy(&eight, flags + 8 * i, 8);
    // Moves bit 8 k of `eight` to bit 56 + k without collisions.
    word |= (eight * 0x0102040810204080u) >> 56 << 8 * i;
  }
  return word;
}

// Sets bit i of `bits` iff predicate(sample i), for `count` samples; the rest of the last word is
// 0.
template <typename T, typename Predicate>
void ClassifySamples(const char* bytes, std::size_t count, const Predicate& predicate,
                     std::uint64_t* bits) {
  std::array<std::uint8_t, 64> flags;
  std::size_t word = 0;
  for (; (word + 1) * 64 <= count; ++word) {
    const char* in = bytes + word * 64 * sizeof(T);
    for (std::size_t i = 0; i < 64; ++i) {
      flags[i] = predicate(LoadSample<T>(in, i)) ? 1 : 0;
    }
    bits[word] = PackBits(flags.data());
  }
  if (word * 64 < count) {
    const char* in = bytes + word * 64 * sizeof(T);
    flags.fill(0);
    for (std::size_t i = 0; i < count - word * 64; ++i) {
      flags[i] = predicate(LoadSample<T>(in, i)) ? 1 : 0;
    }
    bits[word] = PackBits(flags.data());
  }
}

// True iff plain differences of these samples can overflow or are not finite: some sample is NaN,
// infinite or, for doubles, at least 2^1022.
template <typename T>
bool HasExtremeSamples(const char* bytes, std::size_t count) {
  if constexpr (std::is_floating_point_v<T>) {
    using Bits = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
    constexpr T kLimit =
        std::is_same_v<T, float> ? std::numeric_limits<T>::infinity() : static_cast<T>(0x1.0p1022);
    const auto limit = std::bit_cast<Bits>(kLimit);
    Bits found = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Bits magnitude = LoadSample<Bits>(bytes, i) & (~Bits{0} >> 1);
      found |= magnitude >= limit ? Bits{1} : Bits{0};
    }
    return found != 0;
  } else {
    return false;
  }
}

// What the differences of two samples are kept as: exact for integers, double for the others.
template <typename T>
using Difference =
    std::conditional_t<std::is_integral_v<T> && sizeof(T) <= 2, std::int32_t, double>;

template <typename T>
Difference<T> Subtract(T a, T b) {
  return static_cast<Difference<T>>(a) - static_cast<Difference<T>>(b);
}

constexpr std::size_t kBatch = 128;

// Vertices on edges of one axis on their way from samples to positions and normals.
template <typename D>
struct VertexBatch {
  // t = numerator / denominator.
  alignas(64) std::array<double, kBatch> numerators;
  alignas(64) std::array<double, kBatch> denominators;
  // Twice the gradient in index space at the edge's lower and upper sample.
  alignas(64) std::array<std::array<D, kBatch>, 3> lower_gradients;
  alignas(64) std::array<std::array<D, kBatch>, 3> upper_gradients;
  alignas(64) std::array<std::array<float, kBatch>, 3> positions;
  alignas(64) std::array<std::array<float, kBatch>, 3> normals;
};

// Where a block lies, for kernels.
struct BlockGrid {
  std::array<std::size_t, 3> strides;  // in samples
  std::array<std::size_t, 3> dims;     // stored samples
  Vec3d begin;                         // first stored sample, in the volume's samples
  double row_inverse = 0;
  double slice_inverse = 0;
};

// Twice the gradient component along `axis` at `sample`: the central difference, or the one-sided
// one where a neighbour is missing or not finite, or 0.
template <typename T>
Difference<T> CarefulGradient(const char* bytes, const BlockGrid& grid, std::size_t sample,
                              std::size_t axis) {
  const std::size_t stride = grid.strides[axis];
  const std::size_t coordinate = sample / stride % grid.dims[axis];
  const T center = LoadSample<T>(bytes, sample);
  T lower = center;
  T upper = center;
  bool has_lower = coordinate > 0;
  bool has_upper = coordinate + 1 < grid.dims[axis];
  if (has_lower) {
    lower = LoadSample<T>(bytes, sample - stride);
  }
  if (has_upper) {
    upper = LoadSample<T>(bytes, sample + stride);
  }
  if constexpr (std::is_floating_point_v<T>) {
    has_lower = has_lower && std::isfinite(lower);
    has_upper = has_upper && std::isfinite(upper);
    if (!(has_lower && has_upper) && !std::isfinite(center)) {
      return 0;
    }
  }
  if (has_lower && has_upper) {
    return Subtract<T>(upper, lower);
  }
  if (has_upper) {
    return 2 * Subtract<T>(upper, center);
  }
  return has_lower ? 2 * Subtract<T>(center, lower) : Difference<T>{0};
}

struct Fraction {
  double numerator = 0;
  double denominator = 1;
};

// t of a crossed edge, for samples that may be infinite or overflow when subtracted: the limits.
inline Fraction CarefulFraction(double lower, double upper, double isovalue) {
  if (std::isinf(lower)) {
    return std::isinf(upper) ? Fraction{1, 2} : Fraction{1, 1};
  }
  if (std::isinf(upper)) {
    return {0, 1};
  }
  const double denominator = upper - lower;
  if (std::isinf(denominator)) {
    return {isovalue / 2 - lower / 2, upper / 2 - lower / 2};
  }
  return {isovalue - lower, denominator};
}

// Which vertices need the checks of CarefulGradient.
enum class Care {
  kNone,    // no sample is extreme and the block has ghosts all around
  kBorder,  // no sample is extreme; only edges that are not interior lack neighbours
  kFull,
};

template <typename T, Care kCare>
void GatherVertices(const char* bytes, const BlockGrid& grid, const BitRow& interior,
                    std::size_t axis, double isovalue, const std::uint32_t* samples,
                    std::size_t count, VertexBatch<Difference<T>>* batch) {
  const std::size_t stride = grid.strides[axis];
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t lower = samples[i];
    const std::size_t upper = lower + stride;
    const auto a = static_cast<double>(LoadSample<T>(bytes, lower));
    const auto b = static_cast<double>(LoadSample<T>(bytes, upper));
    const bool careful = kCare == Care::kFull ||
                         (kCare == Care::kBorder && (interior[lower / 64] >> lower % 64 & 1) == 0);
    if (careful) {
      const Fraction t = CarefulFraction(a, b, isovalue);
      batch->numerators[i] = t.numerator;
      batch->denominators[i] = t.denominator;
      for (std::size_t k = 0; k < 3; ++k) {
        batch->lower_gradients[k][i] = CarefulGradient<T>(bytes, grid, lower, k);
        batch->upper_gradients[k][i] = CarefulGradient<T>(bytes, grid, upper, k);
      }
    } else {
      batch->numerators[i] = isovalue - a;
      batch->denominators[i] = b - a;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t step = grid.strides[k];
        batch->lower_gradients[k][i] =
            Subtract<T>(LoadSample<T>(bytes, lower + step), LoadSample<T>(bytes, lower - step));
        batch->upper_gradients[k][i] =
            Subtract<T>(LoadSample<T>(bytes, upper + step), LoadSample<T>(bytes, upper - step));
      }
    }
  }
}

// Positions and normals of a batch; straight-line arithmetic that compilers turn into SIMD. Without
// contraction every operation rounds once, so the width of the registers does not matter.
template <std::size_t kAxis, typename D>
void ComputeVertices(const BlockGrid& grid, const math::Mat3d& to_world,
                     const std::uint32_t* samples, std::size_t count, VertexBatch<D>* batch) {
  const auto row = static_cast<double>(grid.strides[1]);
  const auto slice = static_cast<double>(grid.strides[2]);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = batch->numerators[i] / batch->denominators[i];
    const auto linear = static_cast<double>(static_cast<std::int32_t>(samples[i]));
    const auto z =
        static_cast<double>(static_cast<std::int32_t>((linear + 0.5) * grid.slice_inverse));
    const double in_slice = linear - z * slice;
    const auto y =
        static_cast<double>(static_cast<std::int32_t>((in_slice + 0.5) * grid.row_inverse));
    const double x = in_slice - y * row;
    batch->positions[0][i] = static_cast<float>(grid.begin.x + x + (kAxis == 0 ? t : 0.0));
    batch->positions[1][i] = static_cast<float>(grid.begin.y + y + (kAxis == 1 ? t : 0.0));
    batch->positions[2][i] = static_cast<float>(grid.begin.z + z + (kAxis == 2 ? t : 0.0));

    const auto gradient = [&](std::size_t k) {
      const auto lower = static_cast<double>(batch->lower_gradients[k][i]);
      const auto upper = static_cast<double>(batch->upper_gradients[k][i]);
      return lower + t * (upper - lower);
    };
    const Vec3d g = -(to_world * Vec3d{gradient(0), gradient(1), gradient(2)});
    // Scaled first, so that squares neither overflow nor vanish.
    const double ax = std::fabs(g.x);
    const double ay = std::fabs(g.y);
    const double az = std::fabs(g.z);
    const double axy = ax > ay ? ax : ay;
    const double scale = 1.0 / (axy > az ? axy : az);
    const double nx = g.x * scale;
    const double ny = g.y * scale;
    const double nz = g.z * scale;
    const double square = nx * nx + ny * ny + nz * nz;
    // False for NaN: the gradient is zero or not finite.
    const bool usable = square >= 0.5 && square <= 4.0;
    const double inverse = 1.0 / std::sqrt(square);
    batch->normals[0][i] = usable ? static_cast<float>(nx * inverse) : 0.0F;
    batch->normals[1][i] = usable ? static_cast<float>(ny * inverse) : 0.0F;
    batch->normals[2][i] = usable ? static_cast<float>(nz * inverse) : 0.0F;
  }
}

}  // namespace

// Passes over a block: (1) one bit a sample: inside or not; (2) crossed edges and active cells from
// shifts of those bits; (3) a number for every crossed edge; (4) positions and normals, in batches;
// (5) triangles.
class BlockExtractor::Impl {
 public:
  Impl(const volume::GridGeometry& geometry, const volume::BlockLayout& layout)
      : layout_(layout),
        to_world_(geometry.world_gradient_from_index()),
        case_table_(GetCaseTable()) {}

  template <typename T>
  void Extract(const volume::BlockSamples& samples, double isovalue, const ExtractOptions& options,
               mesh::BlockMesh* mesh) {
    UseBlock(samples.block_id);
    mesh->block_id = samples.block_id;
    mesh->owned_vertex_count = 0;
    mesh->edge_keys.clear();
    const volume::Threshold<T> threshold = volume::InsideThreshold<T>(isovalue);
    std::size_t vertex_count = 0;
    Care care = shape_->touches_border ? Care::kBorder : Care::kNone;
    if (threshold.any) {
      ClassifySamples<T>(
          samples.bytes, shape_->sample_count,
          [value = threshold.value](T s) { return s >= value; }, inside_.data() + padding_);
      const bool extreme = HasExtremeSamples<T>(samples.bytes, shape_->sample_count);
      if (extreme) {
        care = Care::kFull;
        // False for NaN only, in a form that vectorises for every type.
        // NOLINTNEXTLINE(misc-redundant-expression)
        const auto is_number = [](T s) { return s == s; };
        ClassifySamples<T>(samples.bytes, shape_->sample_count, is_number,
                           valid_.data() + padding_);
        mesh->owned_vertex_count = FindCrossings<true>();
      } else {
        mesh->owned_vertex_count = FindCrossings<false>();
      }
      vertex_count = NumberVertices();
    }
    mesh->positions.resize(vertex_count);
    mesh->normals.resize(vertex_count);
    if (vertex_count == 0) {
      mesh->indices.clear();
      return;
    }
    if (care == Care::kNone) {
      PlaceVertices<T, Care::kNone>(samples.bytes, isovalue, mesh);
    } else if (care == Care::kBorder) {
      PlaceVertices<T, Care::kBorder>(samples.bytes, isovalue, mesh);
    } else {
      PlaceVertices<T, Care::kFull>(samples.bytes, isovalue, mesh);
    }
    if (options.with_edge_keys) {
      FillEdgeKeys(mesh);
    }
    MakeTriangles(mesh);
  }

 private:
  // Points shape_, grid_ and the scratch space at the block.
  void UseBlock(volume::BlockId id) {
    std::optional<BlockShape>& shape = shapes_[ShapeClassOf(layout_, id)];
    if (!shape.has_value()) {
      shape = MakeBlockShape(layout_, id);
    }
    shape_ = &*shape;
    stored_begin_ = layout_.StoredSamplesOf(id).begin;
    grid_.strides = {1, shape_->row, shape_->slice};
    for (std::size_t k = 0; k < 3; ++k) {
      grid_.dims[k] = static_cast<std::size_t>(shape_->stored_dims[static_cast<int>(k)]);
    }
    grid_.begin = {static_cast<double>(stored_begin_.x), static_cast<double>(stored_begin_.y),
                   static_cast<double>(stored_begin_.z)};
    grid_.row_inverse = 1.0 / static_cast<double>(shape_->row);
    grid_.slice_inverse = 1.0 / static_cast<double>(shape_->slice);
    // Shifts read this many words past both ends; what they read there is masked.
    padding_ = (shape_->slice + shape_->row + 1) / 64 + 2;
    const std::size_t padded = shape_->word_count + 2 * padding_;
    for (BitRow* row : {&inside_, &valid_, &valid_cells_}) {
      if (row->size() < padded) {
        row->resize(padded);
      }
    }
    for (BitRow& row : crossed_) {
      if (row.size() < shape_->word_count) {
        row.resize(shape_->word_count);
      }
    }
    if (active_cells_.size() < shape_->word_count) {
      active_cells_.resize(shape_->word_count);
    }
    if (vertex_ids_.size() < 4 * shape_->sample_count) {
      vertex_ids_.resize(4 * shape_->sample_count);
    }
  }

  // Pass 2. Fills crossed_ and active_cells_; returns the number of owned crossed edges.
  template <bool kHasNan>
  std::int64_t FindCrossings() {
    const std::size_t words = shape_->word_count;
    const std::uint64_t* inside = inside_.data() + padding_;
    const std::uint64_t* valid = valid_.data() + padding_;
    std::uint64_t* valid_cells = valid_cells_.data() + padding_;
    const std::size_t row = shape_->row;
    const std::size_t slice = shape_->slice;
    for (std::size_t i = 0; i < words; ++i) {
      const auto corners = [&](const std::uint64_t* bits) {
        return std::array<std::uint64_t, 8>{bits[i],
                                            Shifted(bits, i, 1),
                                            Shifted(bits, i, row),
                                            Shifted(bits, i, row + 1),
                                            Shifted(bits, i, slice),
                                            Shifted(bits, i, slice + 1),
                                            Shifted(bits, i, slice + row),
                                            Shifted(bits, i, slice + row + 1)};
      };
      const std::array<std::uint64_t, 8> c = corners(inside);
      const std::uint64_t any = c[0] | c[1] | c[2] | c[3] | c[4] | c[5] | c[6] | c[7];
      const std::uint64_t all = c[0] & c[1] & c[2] & c[3] & c[4] & c[5] & c[6] & c[7];
      std::uint64_t cells = shape_->cells[i];
      crossed_[0][i] = (c[0] ^ c[1]) & shape_->edges[0][i];
      crossed_[1][i] = (c[0] ^ c[2]) & shape_->edges[1][i];
      crossed_[2][i] = (c[0] ^ c[4]) & shape_->edges[2][i];
      if constexpr (kHasNan) {
        const std::array<std::uint64_t, 8> v = corners(valid);
        cells &= v[0] & v[1] & v[2] & v[3] & v[4] & v[5] & v[6] & v[7];
        valid_cells[i] = cells;
        crossed_[0][i] &= v[0] & v[1];
        crossed_[1][i] &= v[0] & v[2];
        crossed_[2][i] &= v[0] & v[4];
      }
      active_cells_[i] = any & ~all & cells;
    }
    std::int64_t owned = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < words; ++i) {
        owned += std::popcount(crossed_[axis][i] & shape_->owned_edges[axis][i]);
      }
    }
    if constexpr (kHasNan) {
      DropEdgesWithoutCells();
    }
    return owned;
  }

  // Removes from crossed_ the edges that no valid cell of the block touches.
  void DropEdgesWithoutCells() {
    const std::size_t words = shape_->word_count;
    const std::uint64_t* cells = valid_cells_.data() + padding_;
    std::fill(valid_cells_.begin(), valid_cells_.begin() + static_cast<std::ptrdiff_t>(padding_),
              0);
    // Bits [64 word - offset, 64 word - offset + 64).
    const auto back = [&](std::size_t word, std::size_t offset) {
      const std::uint64_t* at = cells + word - offset / 64;
      const std::size_t shift = offset % 64;
      return at[0] << shift | at[-1] >> 1 >> (63 - shift);
    };
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t u = grid_.strides[(axis + 1) % 3];
      const std::size_t v = grid_.strides[(axis + 2) % 3];
      for (std::size_t i = 0; i < words; ++i) {
        crossed_[axis][i] &= cells[i] | back(i, u) | back(i, v) | back(i, u + v);
      }
    }
  }

  // Pass 3. Fills edge_samples_, axis_begin_ and vertex_ids_; returns the number of vertices.
  std::size_t NumberVertices() {
    edge_samples_.clear();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      axis_begin_[axis] = edge_samples_.size();
      for (std::size_t i = 0; i < shape_->word_count; ++i) {
        for (std::uint64_t rest = crossed_[axis][i]; rest != 0; rest &= rest - 1) {
          const std::size_t sample = 64 * i + static_cast<std::size_t>(std::countr_zero(rest));
          vertex_ids_[4 * sample + axis] = static_cast<std::uint32_t>(edge_samples_.size());
          edge_samples_.push_back(static_cast<std::uint32_t>(sample));
        }
      }
    }
    axis_begin_[3] = edge_samples_.size();
    return edge_samples_.size();
  }

  // Pass 4.
  template <typename T, Care kCare>
  void PlaceVertices(const char* bytes, double isovalue, mesh::BlockMesh* mesh) const {
    VertexBatch<Difference<T>> batch;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t begin = axis_begin_[axis]; begin < axis_begin_[axis + 1]; begin += kBatch) {
        const std::size_t count = std::min(kBatch, axis_begin_[axis + 1] - begin);
        const std::uint32_t* samples = edge_samples_.data() + begin;
        GatherVertices<T, kCare>(bytes, grid_, shape_->interior, axis, isovalue, samples, count,
                                 &batch);
        if (axis == 0) {
          ComputeVertices<0>(grid_, to_world_, samples, count, &batch);
        } else if (axis == 1) {
          ComputeVertices<1>(grid_, to_world_, samples, count, &batch);
        } else {
          ComputeVertices<2>(grid_, to_world_, samples, count, &batch);
        }
        for (std::size_t i = 0; i < count; ++i) {
          mesh->positions[begin + i] = {batch.positions[0][i], batch.positions[1][i],
                                        batch.positions[2][i]};
          mesh->normals[begin + i] = {batch.normals[0][i], batch.normals[1][i],
                                      batch.normals[2][i]};
        }
      }
    }
  }

  void FillEdgeKeys(mesh::BlockMesh* mesh) const {
    const Index3& dims = layout_.sample_dims();
    mesh->edge_keys.reserve(edge_samples_.size());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = axis_begin_[axis]; i < axis_begin_[axis + 1]; ++i) {
        const std::size_t sample = edge_samples_[i];
        const std::int64_t x = stored_begin_.x + static_cast<std::int64_t>(sample % shape_->row);
        const std::int64_t y =
            stored_begin_.y + static_cast<std::int64_t>(sample % shape_->slice / shape_->row);
        const std::int64_t z = stored_begin_.z + static_cast<std::int64_t>(sample / shape_->slice);
        mesh->edge_keys.push_back(3 * (x + dims.x * (y + dims.y * z)) +
                                  static_cast<std::int64_t>(axis));
      }
    }
  }

  // Pass 5.
  void MakeTriangles(mesh::BlockMesh* mesh) {
    const std::uint64_t* inside = inside_.data() + padding_;
    const std::size_t row = shape_->row;
    const std::size_t slice = shape_->slice;
    cells_.clear();
    std::size_t triangle_count = 0;
    for (std::size_t i = 0; i < shape_->word_count; ++i) {
      std::uint64_t rest = active_cells_[i];
      if (rest == 0) {
        continue;
      }
      const std::array<std::uint64_t, 8> corners{inside[i],
                                                 Shifted(inside, i, 1),
                                                 Shifted(inside, i, row),
                                                 Shifted(inside, i, row + 1),
                                                 Shifted(inside, i, slice),
                                                 Shifted(inside, i, slice + 1),
                                                 Shifted(inside, i, slice + row),
                                                 Shifted(inside, i, slice + row + 1)};
      for (; rest != 0; rest &= rest - 1) {
        const int bit = std::countr_zero(rest);
        std::uint64_t cell_case = 0;
        for (std::size_t corner = 0; corner < 8; ++corner) {
          cell_case |= (corners[corner] >> bit & 1) << corner;
        }
        triangle_count += case_table_.triangle_counts[cell_case];
        cells_.push_back({static_cast<std::uint32_t>(64 * i + static_cast<std::size_t>(bit)),
                          static_cast<std::uint32_t>(cell_case)});
      }
    }
    std::array<std::size_t, 12> edge_offsets{};
    for (std::size_t edge = 0; edge < 12; ++edge) {
      const auto corner = static_cast<std::size_t>(CornersOfEdge(static_cast<int>(edge)).lower);
      edge_offsets[edge] =
          4 * ((corner & 1) + (corner >> 1 & 1) * row + (corner >> 2) * slice) + edge / 4;
    }
    mesh->indices.resize(3 * triangle_count);
    std::uint32_t* out = mesh->indices.data();
    for (const ActiveCell& cell : cells_) {
      const std::uint32_t* ids = vertex_ids_.data() + 4 * std::size_t{cell.sample};
      const std::uint8_t* edges = case_table_.edges[cell.cell_case].data();
      const std::size_t count = 3 * std::size_t{case_table_.triangle_counts[cell.cell_case]};
      for (std::size_t k = 0; k < count; ++k) {
        out[k] = ids[edge_offsets[edges[k]]];
      }
      out += count;
    }
  }

  struct ActiveCell {
    std::uint32_t sample;  // the lowest one
    std::uint32_t cell_case;
  };

  const volume::BlockLayout layout_;
  const math::Mat3d to_world_;
  const CaseTable& case_table_;
  std::array<std::optional<BlockShape>, kShapeClassCount> shapes_;

  // The block at hand.
  const BlockShape* shape_ = nullptr;
  Index3 stored_begin_;
  BlockGrid grid_;
  std::size_t padding_ = 0;  // words before bit 0 of inside_, valid_ and valid_cells_

  BitRow inside_;
  BitRow valid_;        // not NaN
  BitRow valid_cells_;  // no corner is NaN
  std::array<BitRow, 3> crossed_;
  BitRow active_cells_;
  std::vector<std::uint32_t> edge_samples_;  // lower samples of crossed edges, by axis
  std::array<std::size_t, 4> axis_begin_{};  // ranges of edge_samples_
  std::vector<std::uint32_t> vertex_ids_;    // [sample][axis of 4], only crossed edges are filled
  std::vector<ActiveCell> cells_;
};

BlockExtractor::BlockExtractor(const volume::GridGeometry& geometry,
                               const volume::BlockLayout& layout)
    : impl_(std::make_unique<Impl>(geometry, layout)) {}
BlockExtractor::~BlockExtractor() = default;
BlockExtractor::BlockExtractor(BlockExtractor&&) noexcept = default;
BlockExtractor& BlockExtractor::operator=(BlockExtractor&&) noexcept = default;

void BlockExtractor::Extract(const volume::BlockSamples& samples, double isovalue,
                             const ExtractOptions& options, mesh::BlockMesh* mesh) {
  ISOSCOPE_DCHECK(std::isfinite(isovalue));
  volume::VisitScalarType(
      samples.type, [&]<typename T>() { impl_->Extract<T>(samples, isovalue, options, mesh); });
}

}  // namespace isoscope::extract
