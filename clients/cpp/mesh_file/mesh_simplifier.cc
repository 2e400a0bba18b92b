// Simplification in parts, so that memory is bounded whatever the size of the mesh:
//
// 1. RunRound goes through the triangles in parts of part_triangle_count, in the order of the
//    stream. libmeshoptimizer simplifies each part; vertices that parts share are locked.
// 2. A mesh of several parts gets up to three rounds. Each shifts the borders of the parts, so that
//    earlier borders are simplified, too.
// 3. SeparateTouchingParts sees to it that each edge has two triangles again (mesh_repair.h).
//
// The error budget is split over the rounds, because their errors add up.

#include "clients/cpp/mesh_file/mesh_simplifier.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "absl/container/flat_hash_set.h"

#include "clients/cpp/mesh_file/mesh_repair.h"
#include "core/base/status_macros.h"

namespace isoscope::client {
namespace {

constexpr int kMaxRounds = 3;
// A mesh this close to its target size needs no further round.
constexpr double kNearlyThere = 1.02;
// No bound, for libmeshoptimizer: its errors are relative to the size of the mesh.
constexpr float kAnyError = 1e10F;

// Moves positions by steps of float32 until all differ. libmeshoptimizer takes vertices of one
// place for the seam of a texture, and joins parts of the surface that only touch there.
void TellApart(std::vector<float>* positions) {
  absl::flat_hash_set<std::array<std::uint32_t, 3>> seen;
  for (std::size_t i = 0; i < positions->size(); i += 3) {
    const auto key = [&] {
      std::array<std::uint32_t, 3> bits{};
      for (std::size_t k = 0; k < 3; ++k) {
        bits[k] = std::bit_cast<std::uint32_t>((*positions)[i + k] + 0.0F);  // -0 is 0
      }
      return bits;
    };
    while (!seen.insert(key()).second) {
      (*positions)[i] = std::nextafter((*positions)[i], std::numeric_limits<float>::infinity());
    }
  }
}

class Simplifier {
 public:
  Simplifier(const SimplifyOptions& options, MeshStore* mesh, io::FileArray<std::uint32_t> local)
      : options_(options), mesh_(*mesh), local_plus_one_(std::move(local)) {}

  absl::StatusOr<SimplifyResult> Run() {
    const double aim = options_.share.value_or(0) * static_cast<double>(mesh_.triangle_count());
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
    // A collapse may bring parts together that only came near.
    ISOSCOPE_RETURN_IF_ERROR(SeparateTouchingParts(&mesh_).status());
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
    TellApart(&positions_);
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
