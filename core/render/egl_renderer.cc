// A pass (EglRenderPass) draws in batches on the one GL thread:
//
// 1. Add collects meshes, on any thread, until they have batch_bytes.
// 2. The thread that fills the batch waits for the batch in flight, composites its picture into the
//    image of the pass (Absorb), and submits the new batch (SubmitCollected).
// 3. Finish submits the rest, absorbs it, and returns the image.
//
// So a pass holds at most two batches. Batch and pass are separate objects. A pass that is
// destroyed marks its batch as abandoned, and the GL thread stops at the next chunk
// (gl_mesh_drawer.h).
//
// Locks: drawing_mutex_ is held while a thread exchanges a batch. mutex_ guards the collected
// meshes.

#include "core/render/egl_renderer.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"

#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/composite/depth_composite.h"
#include "core/mesh/block_mesh.h"
#include "core/render/gl_mesh_drawer.h"
#include "core/view/camera.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::render {
namespace {

// The work that a pass hands to the GL thread. Both share it, so that neither waits for the other
// when a frame is abandoned.
struct Batch {
  Batch(const view::View& batch_view, std::vector<frame::Surface> batch_surfaces,
        view::Clipper batch_clipper, const image::FragmentOrder& batch_order,
        bool batch_sends_normals, std::vector<DrawItem> batch_items)
      : view(batch_view),
        surfaces(std::move(batch_surfaces)),
        clipper(std::move(batch_clipper)),
        order(batch_order),
        sends_normals(batch_sends_normals),
        items(std::move(batch_items)) {}

  const view::View view;
  const std::vector<frame::Surface> surfaces;
  const view::Clipper clipper;
  const image::FragmentOrder order;
  const bool sends_normals;
  std::vector<DrawItem> items;  // taken by the GL thread
  std::atomic<bool> abandoned{false};
  // Written by the GL thread before is_drawn.
  absl::StatusOr<image::FrameImage> result = absl::UnknownError("not drawn");

  base::Mutex mutex;
  base::CondVar drawn;
  bool is_drawn ABSL_GUARDED_BY(mutex) = false;
};

absl::StatusOr<image::FrameImage> TryDraw(GlMeshDrawer* drawer, Batch* batch,
                                          absl::FunctionRef<absl::Status()> poll) {
  try {
    return drawer->Draw(batch->view, batch->surfaces, batch->clipper, batch->order,
                        batch->sends_normals, std::move(batch->items), poll);
  } catch (const std::bad_alloc&) {
    return NoMemoryFor(batch->view.viewport());
  }
}

class EglRenderPass : public RenderPass {
 public:
  EglRenderPass(const view::View& view, const volume::BlockLayout& layout,
                const frame::FrameSpec& spec, std::size_t batch_bytes, GlThread* thread,
                GlMeshDrawer* drawer)
      : view_(view),
        layout_(layout),
        surfaces_(spec.surfaces),
        clipper_(spec.clip, view.geometry()),
        order_{.block_count = static_cast<std::uint32_t>(layout.block_count()),
               .ties = frame::TieRuleOf(frame::BackEnd::kEgl)},
        sends_normals_(spec.sends_normals),
        batch_bytes_(batch_bytes),
        thread_(*thread),
        drawer_(*drawer) {}

  EglRenderPass(const EglRenderPass&) = delete;
  EglRenderPass& operator=(const EglRenderPass&) = delete;

  ~EglRenderPass() override {
    if (in_flight_ != nullptr) {
      in_flight_->abandoned.store(true, std::memory_order_release);
    }
  }

  using RenderPass::Add;
  absl::Status Add(std::span<const MeshToDraw> meshes) override {
    for (const MeshToDraw& item : meshes) {
      ISOSCOPE_RETURN_IF_ERROR(AddOne(item));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) override {
    const base::MutexLock drawing_lock(&drawing_mutex_);
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_RETURN_IF_ERROR(Absorb(&cancellation));
    // An empty pass draws once, too: a picture that is too large fails whether or not a block is on
    // it.
    if (!image_.has_value() || HasCollected()) {
      SubmitCollected();
      ISOSCOPE_RETURN_IF_ERROR(Absorb(&cancellation));
    }
    return *std::move(image_);
  }

 private:
  absl::Status AddOne(const MeshToDraw& item) {
    const std::shared_ptr<const mesh::CompactMesh>& mesh = item.mesh;
    ISOSCOPE_CHECK(mesh != nullptr);
    ISOSCOPE_CHECK_LT(item.surface_index, surfaces_.size());
    ISOSCOPE_CHECK_EQ(mesh->positions.size(), mesh->normals.size());
    if (mesh->block_id >= layout_.block_count()) {
      return absl::InvalidArgumentError(absl::StrCat("a mesh of block ", mesh->block_id,
                                                     ", but the layout has only ",
                                                     layout_.block_count(), " blocks"));
    }
    if (mesh->triangles.empty()) {
      return absl::OkStatus();
    }
    const view::Footprint footprint = view_.FootprintOf(layout_, mesh->block_id);
    if (footprint.rect.empty()) {
      return absl::OkStatus();
    }
    {
      const base::MutexLock lock(&mutex_);
      collected_bytes_ += mesh->size_bytes();
      // The mask is copied, because the GL thread may still draw when an abandoned pass is gone.
      collected_.push_back(
          {.mesh = mesh,
           .surface_index = item.surface_index,
           .footprint = footprint,
           .open = item.open == nullptr ? std::nullopt : std::optional(*item.open)});
      if (collected_bytes_ < batch_bytes_) {
        return absl::OkStatus();
      }
    }
    const base::MutexLock drawing_lock(&drawing_mutex_);
    {
      // Another thread may have drawn the batch while this one waited for its turn.
      const base::MutexLock lock(&mutex_);
      if (collected_bytes_ < batch_bytes_) {
        return absl::OkStatus();
      }
    }
    // The GL thread has at most one batch while the pass collects the next.
    ISOSCOPE_RETURN_IF_ERROR(Absorb(nullptr));
    SubmitCollected();
    return absl::OkStatus();
  }

  bool HasCollected() {
    const base::MutexLock lock(&mutex_);
    return !collected_.empty();
  }

  void SubmitCollected() ABSL_EXCLUSIVE_LOCKS_REQUIRED(drawing_mutex_) {
    std::vector<DrawItem> items;
    {
      const base::MutexLock lock(&mutex_);
      items = std::exchange(collected_, {});
      collected_bytes_ = 0;
    }
    in_flight_ = std::make_shared<Batch>(view_, surfaces_, clipper_, order_, sends_normals_,
                                         std::move(items));
    thread_.Submit([batch = in_flight_, &drawer = drawer_]() {
      const auto poll = [&batch]() {
        return batch->abandoned.load(std::memory_order_acquire)
                   ? absl::CancelledError("the frame was given up")
                   : absl::OkStatus();
      };
      batch->result = TryDraw(&drawer, batch.get(), poll);
      const base::MutexLock lock(&batch->mutex);
      batch->is_drawn = true;
      batch->drawn.SignalAll();
    });
  }

  // Waits for the batch in flight, if any, and composites it. An error of drawing stays.
  absl::Status Absorb(const base::Cancellation* cancellation)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(drawing_mutex_) {
    ISOSCOPE_RETURN_IF_ERROR(status_);
    if (in_flight_ == nullptr) {
      return absl::OkStatus();
    }
    Batch& waited = *in_flight_;
    static const base::Cancellation kNever;
    status_ = base::AwaitOrCancelled(
        cancellation == nullptr ? kNever : *cancellation, &waited.mutex, &waited.drawn,
        [&waited]() ABSL_SHARED_LOCKS_REQUIRED(waited.mutex) { return waited.is_drawn; });
    if (!status_.ok()) {
      waited.abandoned.store(true, std::memory_order_release);
      return status_;
    }
    const std::shared_ptr<Batch> batch = std::exchange(in_flight_, nullptr);
    status_ = batch->result.status();
    ISOSCOPE_RETURN_IF_ERROR(status_);
    if (image_.has_value()) {
      composite::CompositeInto(*batch->result, order_, &*image_);
    } else {
      image_ = *std::move(batch->result);
    }
    return absl::OkStatus();
  }

  const view::View view_;
  const volume::BlockLayout layout_;
  const std::vector<frame::Surface> surfaces_;
  const view::Clipper clipper_;
  const image::FragmentOrder order_;
  const bool sends_normals_;
  const std::size_t batch_bytes_;
  GlThread& thread_;
  GlMeshDrawer& drawer_;

  // A thread holds it while it exchanges a batch with the GL thread. It is taken before mutex_.
  base::Mutex drawing_mutex_;
  std::shared_ptr<Batch> in_flight_ ABSL_GUARDED_BY(drawing_mutex_);
  std::optional<image::FrameImage> image_ ABSL_GUARDED_BY(drawing_mutex_);
  absl::Status status_ ABSL_GUARDED_BY(drawing_mutex_);

  base::Mutex mutex_;
  std::vector<DrawItem> collected_ ABSL_GUARDED_BY(mutex_);
  std::size_t collected_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<EglRenderer>> EglRenderer::Make(const EglRendererOptions& options) {
  std::unique_ptr<EglRenderer> made(new EglRenderer);
  made->batch_bytes_ = options.batch_bytes;
  made->max_unused_bytes_ = options.max_unused_bytes;
  made->images_ = image::FrameImagePool::Make(options.max_unused_bytes);
  ISOSCOPE_ASSIGN_OR_RETURN(made->thread_, GlThread::Start(options.egl_device));
  absl::Status status;
  absl::Notification done;
  made->thread_->Submit([&made, &status, &done]() {
    absl::StatusOr<std::unique_ptr<GlMeshDrawer>> drawer = GlMeshDrawer::Make(made->images_);
    status = drawer.status();
    if (drawer.ok()) {
      made->drawer_ = *std::move(drawer);
    }
    done.Notify();
  });
  done.WaitForNotification();
  ISOSCOPE_RETURN_IF_ERROR(status);
  return made;
}

void EglRenderer::Prepare(const view::Viewport& viewport, int /*pass_count*/, int image_count) {
  const std::size_t image_bytes = static_cast<std::size_t>(viewport.width_px) *
                                  static_cast<std::size_t>(viewport.height_px) *
                                  (sizeof(std::uint64_t) + sizeof(image::Rgba8));
  if (image_bytes > max_unused_bytes_) {
    return;  // too large to keep, maybe too large to draw
  }
  try {
    for (int i = 0; i < image_count; ++i) {
      images_->Prepare(viewport.width_px, viewport.height_px);
    }
  } catch (const std::bad_alloc&) {
    return;  // BeginPass reports it
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = {2, 2, 2};
  const absl::StatusOr<view::View> view =
      view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), viewport, geometry);
  if (!view.ok()) {
    return;
  }
  mesh::BlockMesh triangle;
  triangle.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  triangle.normals.assign(3, {0, 0, 1});
  triangle.indices = {0, 1, 2};
  DrawItem item{.mesh = mesh::Compact(triangle),
                .surface_index = 0,
                .footprint = view->FootprintOf({0, 0, 0}, {1, 1, 1}),
                .open = std::nullopt};
  Batch batch(*view, {frame::Surface()}, {}, {}, /*batch_sends_normals=*/false, {std::move(item)});
  absl::Notification done;
  thread_->Submit([&]() {
    TryDraw(drawer_.get(), &batch, []() { return absl::OkStatus(); }).IgnoreError();
    done.Notify();
  });
  done.WaitForNotification();
}

EglRenderer::~EglRenderer() {
  if (thread_ != nullptr) {
    thread_->Submit([this]() { drawer_.reset(); });
    thread_.reset();
  }
}

absl::StatusOr<std::unique_ptr<RenderPass>> EglRenderer::BeginPass(
    const view::View& view, const volume::BlockLayout& layout, const frame::FrameSpec& spec) {
  const view::Viewport& whole = view.viewport();
  if (std::max(whole.width_px, whole.height_px) > view::kMaxViewportPx) {
    return absl::InvalidArgumentError(
        absl::StrCat("viewport of ", whole.width_px, " x ", whole.height_px,
                     " pixels: OpenGL draws regions of at most ", view::kMaxViewportPx,
                     " pixels a side of the whole; start the agents with --renderer cpu"));
  }
  return std::make_unique<EglRenderPass>(view, layout, spec, batch_bytes_, thread_.get(),
                                         drawer_.get());
}

frame::PictureRevision EglRenderer::picture_revision() const {
  return {.back_end = frame::BackEnd::kEgl, .driver = thread_->driver()};
}

}  // namespace isoscope::render
