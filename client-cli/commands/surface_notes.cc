#include "client-cli/commands/surface_notes.h"

#include <algorithm>
#include <iterator>
#include <ostream>
#include <vector>

#include "client-cli/commands/small_frame.h"
#include "client-cli/output/note_lines.h"
#include "clients/cpp/connection/features.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/frame/frame_spec.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

constexpr int kMaxSidePx = 512;

}  // namespace

absl::Status WriteNotesOf(const v1::RenderIsosurfaceRequest& frame,
                          const std::function<bool(const v1::SurfaceNote&)>& is_wanted,
                          Session* session, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const bool has_notes,
      client::HasFeature("notes", session->question_timeout(), &session->client()));
  if (!has_notes) {
    return absl::OkStatus();
  }
  v1::RenderIsosurfaceRequest small = SmallFrameOf(frame, kMaxSidePx);
  small.set_with_notes(true);
  const absl::StatusOr<v1::RenderIsosurfaceResponse> response =
      session->client().RenderIsosurface(small, session->frame_timeout());
  if (!response.ok()) {
    // The result is written, and right.
    *context.err << "isoscope: surfaces that do not show could not be looked for: "
                 << base::Printable(response.status().message()) << std::endl;
    return absl::IsCancelled(response.status()) ? response.status() : absl::OkStatus();
  }
  FrameRecord record;
  std::copy_if(response->notes().begin(), response->notes().end(), std::back_inserter(record.notes),
               is_wanted);
  WriteNotes({record}, context);
  return absl::OkStatus();
}

absl::Status WriteNotesOnMesh(const v1::ExportIsosurfaceRequest& request,
                              const std::function<bool(int)>& has_triangles, Session* session,
                              const Context& context) {
  v1::RenderIsosurfaceRequest frame;
  v1::ExportIsosurfaceRequest whole = request;
  client::PromoteIsovalue(&whole);
  for (int i = 0; i < whole.surfaces_size(); ++i) {
    const v1::Surface& surface = whole.surfaces(i);
    if ((!has_triangles(i) || surface.labels_size() > 1) &&
        frame.surfaces_size() < static_cast<int>(frame::kMaxSurfaces)) {
      v1::Surface* const plain = frame.add_surfaces();
      plain->set_isovalue(surface.isovalue());
      *plain->mutable_labels() = surface.labels();
    }
  }
  if (frame.surfaces().empty()) {
    return absl::OkStatus();
  }
  frame.set_dataset(request.dataset());
  frame.set_dataset_id(request.dataset_id());
  frame.mutable_viewport()->set_width_px(kMaxSidePx);
  frame.mutable_viewport()->set_height_px(kMaxSidePx);
  if (request.has_clip()) {
    *frame.mutable_clip() = request.clip();
  }
  if (request.has_selection()) {
    *frame.mutable_selection() = request.selection();
  }
  return WriteNotesOf(
      frame,
      [](const v1::SurfaceNote& note) {
        return note.reason() != v1::SurfaceNote::REASON_OUTSIDE_PICTURE;
      },
      session, context);
}

}  // namespace isoscope::cli
