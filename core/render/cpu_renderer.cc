#include "core/render/cpu_renderer.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/status_macros.h"
#include "core/render/cpu_rasterizer.h"

namespace isoscope::render {
namespace {

// Pixels are guarded in squares of this side, one lock each.
constexpr int kLockTilePx = 64;
// The triangle of a pixel whose colour is final for its key.
constexpr std::uint32_t kShaded = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint64_t kBackgroundKey = image::FragmentKey(image::kFarDepth, image::kNoBlock);
// Colour is a function of |n . v| alone; so many steps that none differs by more than one level.
constexpr std::size_t kShadeSteps = 4096;

struct alignas(64) TileLock {
  absl::Mutex mutex;
};

std::vector<image::Rgba8> MakeShadeTable(const Appearance& appearance) {
  std::vector<image::Rgba8> table(kShadeSteps + 1);
  for (std::size_t i = 0; i <= kShadeSteps; ++i) {
    const double c = static_cast<double>(i) / kShadeSteps;
    const auto ambient = static_cast<double>(appearance.ambient);
    const double diffuse = ambient + (1 - ambient) * c;
    const double specular = static_cast<double>(appearance.specular) *
                            std::pow(c, static_cast<double>(appearance.shininess));
    const auto channel = [&](std::uint8_t base) {
      const double value = std::clamp(base / 255.0 * diffuse + specular, 0.0, 1.0);
      return static_cast<std::uint8_t>(std::lround(value * 255));
    };
    table[i] = {channel(appearance.base_color.r), channel(appearance.base_color.g),
                channel(appearance.base_color.b), 255};
  }
  return table;
}

class CpuPass final : public RenderPass {
 public:
  CpuPass(const view::View& view, const volume::BlockLayout& layout, const Appearance& appearance,
          std::size_t max_kept_bytes)
      : view_(view),
        layout_(layout),
        max_kept_bytes_(max_kept_bytes),
        shade_table_(MakeShadeTable(appearance)),
        width_(view.viewport().width_px),
        height_(view.viewport().height_px),
        lock_columns_(static_cast<std::size_t>((width_ + kLockTilePx - 1) / kLockTilePx)),
        locks_(lock_columns_ * static_cast<std::size_t>((height_ + kLockTilePx - 1) / kLockTilePx)),
        keys_(PixelCount(), kBackgroundKey),
        triangles_(PixelCount(), kShaded),
        colors_(PixelCount()) {}

  absl::Status Add(std::shared_ptr<const mesh::BlockMesh> mesh) override {
    if (std::int64_t{mesh->block_id} >= layout_.block_count()) {
      return absl::InvalidArgumentError(absl::StrFormat("block %d: the layout has %d blocks",
                                                        mesh->block_id, layout_.block_count()));
    }
    if (mesh->indices.empty()) {
      return absl::OkStatus();
    }
    const view::Footprint footprint = view_.FootprintOf(layout_, mesh->block_id);
    if (footprint.rect.empty()) {
      return absl::OkStatus();
    }
    bool must_shade = false;
    {
      // Shared: many meshes are drawn at a time; exclusive: kept meshes are shaded and dropped.
      absl::ReaderMutexLock drawing(&shading_mutex_);
      {
        absl::MutexLock lock(&meshes_mutex_);
        kept_bytes_ += mesh->size_bytes();
        must_shade = kept_bytes_ > max_kept_bytes_;
        meshes_[mesh->block_id] = mesh;
      }
      rasterizers_.local().Rasterize(*mesh, view_, footprint,
                                     [&](const KeyTile& tile) { Merge(tile, mesh->block_id); });
    }
    if (must_shade) {
      ShadeKept();
    }
    return absl::OkStatus();
  }

  absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) override {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ShadeKept();
    image::FrameImage image;
    image.width = width_;
    image.height = height_;
    image.depth.resize(PixelCount());
    image.block_id.resize(PixelCount());
    image.color = std::move(colors_);
    for (std::size_t i = 0; i < PixelCount(); ++i) {
      image.depth[i] = std::bit_cast<float>(static_cast<std::uint32_t>(keys_[i] >> 32));
      image.block_id[i] = static_cast<std::uint32_t>(keys_[i]);
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    return image;
  }

 private:
  using MeshMap = absl::flat_hash_map<volume::BlockId, std::shared_ptr<const mesh::BlockMesh>>;

  [[nodiscard]] std::size_t PixelCount() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }

  // Puts a block's tile into the image, lock tile by lock tile.
  void Merge(const KeyTile& tile, volume::BlockId block_id) {
    const view::PixelRect& rect = tile.rect;
    for (int y = rect.begin_y; y < rect.end_y;) {
      const int end_y = std::min((y / kLockTilePx + 1) * kLockTilePx, rect.end_y);
      for (int x = rect.begin_x; x < rect.end_x;) {
        const int end_x = std::min((x / kLockTilePx + 1) * kLockTilePx, rect.end_x);
        absl::MutexLock lock(&locks_[static_cast<std::size_t>(y / kLockTilePx) * lock_columns_ +
                                     static_cast<std::size_t>(x / kLockTilePx)]
                                  .mutex);
        for (int row = y; row < end_y; ++row) {
          MergeRow(tile, block_id, row, x, end_x);
        }
        x = end_x;
      }
      y = end_y;
    }
  }

  void MergeRow(const KeyTile& tile, volume::BlockId block_id, int y, int begin_x, int end_x) {
    const view::PixelRect& rect = tile.rect;
    const std::uint64_t* from =
        tile.keys + static_cast<std::ptrdiff_t>(y - rect.begin_y) * (rect.end_x - rect.begin_x) -
        rect.begin_x;
    const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(y) * width_;
    for (int x = begin_x; x < end_x; ++x) {
      if (from[x] == KeyTile::kNoKey) {
        continue;
      }
      const std::uint64_t key = (from[x] & 0xffffffff00000000u) | block_id;
      const auto pixel = static_cast<std::size_t>(offset + x);
      if (key < keys_[pixel]) {
        keys_[pixel] = key;
        triangles_[pixel] = static_cast<std::uint32_t>(from[x]);
      }
    }
  }

  // Shades every pixel whose triangle is kept and drops the meshes. Which pixels are shaded early
  // does not change the picture: a later, nearer fragment replaces key and triangle.
  void ShadeKept() {
    absl::MutexLock exclusive(&shading_mutex_);
    MeshMap meshes;
    {
      absl::MutexLock lock(&meshes_mutex_);
      if (meshes_.empty()) {
        return;
      }
      meshes.swap(meshes_);
      kept_bytes_ = 0;
    }
    tbb::parallel_for(0, height_, [&](int y) {
      volume::BlockId last_id = image::kNoBlock;
      const mesh::BlockMesh* last_mesh = nullptr;
      for (int x = 0; x < width_; ++x) {
        const auto pixel = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(y) * width_ + x);
        if (triangles_[pixel] == kShaded) {
          continue;
        }
        const auto id = static_cast<volume::BlockId>(keys_[pixel]);
        if (last_mesh == nullptr || id != last_id) {
          last_id = id;
          last_mesh = meshes.at(id).get();
        }
        colors_[pixel] = Shade(*last_mesh, triangles_[pixel], x, y);
        triangles_[pixel] = kShaded;
      }
    });
  }

  [[nodiscard]] image::Rgba8 Shade(const mesh::BlockMesh& mesh, std::uint32_t triangle, int x,
                                   int y) const {
    const std::array<double, 3> weights = BarycentricsAtPixel(mesh, triangle, view_, x, y);
    math::Vec3d normal;
    math::Vec3d position;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t vertex = mesh.indices[3 * std::size_t{triangle} + i];
      const math::Vec3f& n = mesh.normals[vertex];
      const math::Vec3f& p = mesh.positions[vertex];
      normal = normal + math::Vec3d{static_cast<double>(n.x), static_cast<double>(n.y),
                                    static_cast<double>(n.z)} *
                            weights[i];
      position = position + math::Vec3d{static_cast<double>(p.x), static_cast<double>(p.y),
                                        static_cast<double>(p.z)} *
                                weights[i];
    }
    math::Vec3d to_eye = -view_.forward();
    if (view_.camera().projection == view::Projection::kPerspective) {
      to_eye = view_.camera().eye - math::TransformPoint(view_.world_from_index(), position);
    }
    const double scale = math::Dot(normal, normal) * math::Dot(to_eye, to_eye);
    // No normal: as if it faced the eye.
    const double cosine =
        scale > 0 ? std::min(std::abs(math::Dot(normal, to_eye)) / std::sqrt(scale), 1.0) : 1.0;
    return shade_table_[static_cast<std::size_t>(std::lround(cosine * kShadeSteps))];
  }

  const view::View view_;
  const volume::BlockLayout layout_;
  const std::size_t max_kept_bytes_;
  const std::vector<image::Rgba8> shade_table_;
  const int width_;
  const int height_;
  const std::size_t lock_columns_;
  std::vector<TileLock> locks_;
  // Guarded by the lock of their tile while drawing, by shading_mutex_ while shading.
  std::vector<std::uint64_t> keys_;       // FragmentKey
  std::vector<std::uint32_t> triangles_;  // of the mesh that owns the pixel, or kShaded
  std::vector<image::Rgba8> colors_;
  tbb::enumerable_thread_specific<CpuRasterizer> rasterizers_;
  absl::Mutex shading_mutex_;
  absl::Mutex meshes_mutex_ ABSL_ACQUIRED_AFTER(shading_mutex_);
  MeshMap meshes_ ABSL_GUARDED_BY(meshes_mutex_);
  std::size_t kept_bytes_ ABSL_GUARDED_BY(meshes_mutex_) = 0;
};

class CpuRenderer final : public Renderer {
 public:
  explicit CpuRenderer(std::size_t max_kept_bytes) : max_kept_bytes_(max_kept_bytes) {}

  absl::StatusOr<std::unique_ptr<RenderPass>> BeginPass(const view::View& view,
                                                        const volume::BlockLayout& layout,
                                                        const Appearance& appearance) override {
    return std::make_unique<CpuPass>(view, layout, appearance, max_kept_bytes_);
  }

  [[nodiscard]] std::string description() const override { return "cpu: portable rasterizer"; }

 private:
  const std::size_t max_kept_bytes_;
};

}  // namespace

std::unique_ptr<Renderer> MakeCpuRenderer(std::size_t max_kept_bytes) {
  return std::make_unique<CpuRenderer>(max_kept_bytes);
}

}  // namespace isoscope::render
