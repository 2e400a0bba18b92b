// Simplification in parts, so that memory is bounded whatever the size of the mesh:
//
// 1. WeldEqualPositions joins vertices of one position, which libmeshoptimizer would keep as seams.
// 2. RunRound goes through the triangles in parts of part_triangle_count, in the order of the
//    stream. libmeshoptimizer simplifies each part; vertices that parts share are locked.
// 3. A mesh of several parts gets up to three rounds. Each shifts the borders of the parts, so that
//    earlier borders are simplified, too.
//
// The error budget is split over the rounds, because their errors add up.

#include "clients/cpp/mesh_file/mesh_simplifier.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

constexpr int kMaxRounds = 3;
// A mesh this close to its target size needs no further round.
constexpr double kNearlyThere = 1.02;
// No bound, for libmeshoptimizer: its errors are relative to the size of the mesh.
constexpr float kAnyError = 1e10F;

// Positions as bits, with -0 as 0.
std::array<std::uint32_t, 3> KeyOf(const float* position) {
  std::array<std::uint32_t, 3> key{};
  for (std::size_t k = 0; k < 3; ++k) {
    key[k] = std::bit_cast<std::uint32_t>(position[k] + 0.0F);
  }
  return key;
}

// Joins vertices of equal position into the first of them, and drops triangles that become
// degenerate. Samples equal to the isovalue have such vertices, one for each grid edge that ends
// there. libmeshoptimizer would keep them, as the seams of a texture.
absl::Status WeldEqualPositions(MeshStore* mesh) {
  const auto vertex_count = static_cast<std::size_t>(mesh->vertex_count());
  const float* const positions = mesh->positions().data();
  // An open-addressing hash table of 1 + vertex.
  const std::size_t table_size = std::bit_ceil(2 * vertex_count + 1);
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> table,
                            io::FileArray<std::uint32_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(table.Resize(table_size));
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> first,
                            io::FileArray<std::uint32_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(first.Resize(vertex_count));
  for (std::size_t i = 0; i < vertex_count; ++i) {
    const std::array<std::uint32_t, 3> key = KeyOf(positions + 3 * i);
    std::uint64_t hash = 0;
    for (const std::uint32_t word : key) {
      hash = (hash ^ word) * 0x9e3779b97f4a7c15U;  // 2^64 divided by the golden ratio
      hash ^= hash >> 32;
    }
    std::size_t slot = hash & (table_size - 1);
    while (table.data()[slot] != 0 &&
           KeyOf(positions + 3 * (std::size_t{table.data()[slot]} - 1)) != key) {
      slot = (slot + 1) & (table_size - 1);
    }
    if (table.data()[slot] == 0) {
      table.data()[slot] = static_cast<std::uint32_t>(i + 1);
    }
    first.data()[i] = table.data()[slot] - 1;
  }
  const std::span<std::uint32_t> triangles = mesh->triangles().values();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    const std::uint32_t a = first.data()[triangles[i]];
    const std::uint32_t b = first.data()[triangles[i + 1]];
    const std::uint32_t c = first.data()[triangles[i + 2]];
    if (a != b && b != c && c != a) {
      triangles[kept++] = a;
      triangles[kept++] = b;
      triangles[kept++] = c;
    }
  }
  return mesh->triangles().Resize(kept);
}

class Simplifier {
 public:
  Simplifier(const SimplifyOptions& options, MeshStore* mesh, io::FileArray<std::uint32_t> local)
      : options_(options), mesh_(*mesh), local_plus_one_(std::move(local)) {}

  absl::StatusOr<SimplifyResult> Run() {
    const double aim = options_.share.value_or(0) * static_cast<double>(mesh_.triangle_count());
    ISOSCOPE_RETURN_IF_ERROR(WeldEqualPositions(&mesh_));
    const int round_count = mesh_.triangle_count() <= options_.part_triangle_count ? 1 : kMaxRounds;
    SimplifyResult result;
    for (int round = 0; round < round_count; ++round) {
      const bool is_whole = mesh_.triangle_count() <= options_.part_triangle_count;
      // Errors of rounds add up, so each gets a share of the bound: 1/2, 1/4 and 1/4.
      const double budget = round_count == 1 ? 1 : round == 0 ? 0.5 : 0.25;
      double error = 0;
      ISOSCOPE_RETURN_IF_ERROR(RunRound(round, round_count, aim, budget, &error));
      result.error += error;
      if (is_whole ||
          (options_.share && static_cast<double>(mesh_.triangle_count()) <= kNearlyThere * aim)) {
        break;
      }
    }
    result.triangle_count = mesh_.triangle_count();
    return result;
  }

 private:
  // Simplifies part after part. The first part of every second round has half the length, so that
  // the borders differ.
  absl::Status RunRound(int round, int round_count, double aim, double budget, double* error) {
    const std::int64_t count = mesh_.triangle_count();
    const bool is_whole = count <= options_.part_triangle_count;
    const double share = count == 0 ? 1 : aim / static_cast<double>(count);
    std::size_t kept = 0;
    for (std::int64_t begin = 0; begin < count;) {
      std::int64_t size = options_.part_triangle_count;
      if (begin == 0 && round % 2 == 1 && !is_whole) {
        size = std::max<std::int64_t>(1, size / 2);
      }
      const std::int64_t end = std::min(count, begin + size);
      if (options_.progress) {
        const double done = (round + static_cast<double>(begin) / static_cast<double>(count));
        ISOSCOPE_RETURN_IF_ERROR(options_.progress(done / round_count));
      }
      const auto part = mesh_.triangles().values().subspan(
          static_cast<std::size_t>(3 * begin), static_cast<std::size_t>(3 * (end - begin)));
      const std::size_t index_count = SimplifyPart(part, share, budget, is_whole, error);
      // Parts only shrink, so this writes behind the read position.
      std::copy_n(result_.begin(), index_count,
                  mesh_.triangles().data() + static_cast<std::ptrdiff_t>(kept));
      kept += index_count;
      begin = end;
    }
    return mesh_.triangles().Resize(kept);
  }

  // Stores the remaining triangles in result_, with the mesh's vertices, and returns the number of
  // indices.
  std::size_t SimplifyPart(std::span<const std::uint32_t> part, double share, double budget,
                           bool is_whole, double* error) {
    CollectVertices(part);
    const float* const positions = positions_.data();
    const std::size_t vertex_count = vertices_.size();
    const float scale = meshopt_simplifyScale(positions, vertex_count, 3 * sizeof(float));
    const double bound = options_.max_error.value_or(0) * budget;
    const float relative_bound =
        !options_.max_error ? kAnyError
        : scale > 0         ? static_cast<float>(std::min(bound / static_cast<double>(scale),
                                                          static_cast<double>(kAnyError)))
                            : 0.0F;
    const std::size_t triangle_count = part.size() / 3;
    const auto target = static_cast<std::size_t>(
        options_.share ? std::ceil(std::min(share, 1.0) * static_cast<double>(triangle_count)) : 0);
    float relative_error = 0;
    result_.resize(part.size());
    const std::size_t index_count =
        meshopt_simplify(result_.data(), indices_.data(), indices_.size(), positions, vertex_count,
                         3 * sizeof(float), 3 * target, relative_bound,
                         is_whole ? 0 : meshopt_SimplifyLockBorder, &relative_error);
    for (std::size_t i = 0; i < index_count; ++i) {
      result_[i] = vertices_[result_[i]];
    }
    *error = std::max(*error, static_cast<double>(relative_error) * static_cast<double>(scale));
    return index_count;
  }

  // Numbers the part's vertices in the order in which triangles refer to them.
  void CollectVertices(std::span<const std::uint32_t> part) {
    vertices_.clear();
    positions_.clear();
    indices_.clear();
    std::uint32_t* const local = local_plus_one_.data();
    const float* const all_positions = mesh_.positions().data();
    for (const std::uint32_t vertex : part) {
      if (local[vertex] == 0) {
        vertices_.push_back(vertex);
        local[vertex] = static_cast<std::uint32_t>(vertices_.size());
        const float* const at = all_positions + 3 * std::size_t{vertex};
        positions_.insert(positions_.end(), at, at + 3);
      }
      indices_.push_back(local[vertex] - 1);
    }
    for (const std::uint32_t vertex : vertices_) {
      local[vertex] = 0;
    }
  }

  const SimplifyOptions& options_;
  MeshStore& mesh_;
  io::FileArray<std::uint32_t> local_plus_one_;  // by vertex of the mesh; 0: not in this part
  // Data of the part in work.
  std::vector<std::uint32_t> vertices_;  // of the mesh, by index in the part
  std::vector<float> positions_;
  std::vector<std::uint32_t> indices_;
  std::vector<std::uint32_t> result_;
};

}  // namespace

absl::StatusOr<SimplifyResult> SimplifyMesh(const SimplifyOptions& options, MeshStore* mesh) {
  ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<std::uint32_t> local,
                            io::FileArray<std::uint32_t>::Create(mesh->directory()));
  ISOSCOPE_RETURN_IF_ERROR(local.Resize(static_cast<std::size_t>(mesh->vertex_count())));
  return Simplifier(options, mesh, std::move(local)).Run();
}

}  // namespace isoscope::client
