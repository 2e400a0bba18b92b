// A surface that does not show is one of these, in the order in which they are looked for:
//
// 1. The samples of the volume do not have it: its histogram tells (KnownSamples).
// 2. Other surfaces hide it. The surfaces that do not show are drawn by themselves, opaque, where
//    the picture was drawn. Those that show now were hidden by others, or their own opacity is 0.
//    The rest is drawn once more without these, until no other one shows.
// 3. No cell has it. The rest is drawn without a clip region and without culling: a surface without
//    triangles has no cell.
// 4. The clip region cuts it away, or it lies outside of the picture. With the default camera,
//    which sees the whole volume, the same as in 2 tells these apart.
//
// Each drawing is small, and step 2 ends the search in most pictures. A picture that was drawn in
// bands has memory for no more: then drawings have bands of this size, too, and show what any band
// shows. So the notes are the same for any memory limit.

#include "server/frame/surface_notes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/picture/picture_contents.h"
#include "core/view/camera.h"
#include "server/admission/band_grid.h"
#include "server/frame/known_samples.h"
#include "server/frame/render_statistics.h"
#include "wire/proto_convert.h"
#include "wire/surface_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

using SurfaceSet = std::bitset<frame::kMaxSurfaces>;

view::Viewport Smaller(const view::Viewport& size) {
  const int side = std::max(size.width_px, size.height_px);
  const auto scaled = [&](int px) {
    return side <= kMaxNoteSidePx
               ? px
               : std::max(1, static_cast<int>(std::int64_t{px} * kMaxNoteSidePx / side));
  };
  return {scaled(size.width_px), scaled(size.height_px)};
}

// The differences of a drawing from the picture.
struct Drawing {
  bool sees_all = false;  // with the default camera
  bool is_clipped = true;
  frame::Culling culling = frame::Culling::kDepth;
};

class NoteSearch {
 public:
  explicit NoteSearch(const NotedFrame& frame)
      : frame_(frame), spec_(*frame.spec), identity_(*frame.identity) {
    identity_.trace = nullptr;
    identity_.agent_traces = nullptr;
  }

  absl::StatusOr<std::vector<v1::SurfaceNote>> Run() {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<KnownSamples> samples, AskSamples());
    if (!samples.has_value()) {
      return std::vector<v1::SurfaceNote>();
    }
    notes_.resize(spec_.surfaces.size());
    SurfaceSet unseen;
    for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
      if (const auto note = samples->NoteOf(spec_.surfaces[i].rule); note.has_value()) {
        Add(i, *note);
      }
      const bool is_explained =
          !notes_[i].empty() &&
          notes_[i].front().reason() != v1::SurfaceNote::REASON_SOME_LABELS_MISSING;
      unseen.set(i, !frame_.shown.test(i) && !is_explained);
    }
    ISOSCOPE_RETURN_IF_ERROR(ExplainUnseen(*samples, unseen));
    std::vector<v1::SurfaceNote> notes;
    for (std::vector<v1::SurfaceNote>& of_surface : notes_) {
      std::move(of_surface.begin(), of_surface.end(), std::back_inserter(notes));
    }
    return notes;
  }

 private:
  [[nodiscard]] bool NeedsSamples() const {
    return std::any_of(spec_.surfaces.begin(), spec_.surfaces.end(), [&](const auto& surface) {
      const auto i = static_cast<std::size_t>(&surface - spec_.surfaces.data());
      return surface.rule.has_labels() || !frame_.shown.test(i);
    });
  }

  // Step 1. Not set if no surface needs it, or if agents of an earlier version do not tell enough.
  absl::StatusOr<std::optional<KnownSamples>> AskSamples() {
    const bool is_told =
        frame_.target->dataset->picture_revision.number >= frame::kPictureRevisionNumber;
    if (!NeedsSamples() || !is_told) {
      return std::optional<KnownSamples>();
    }
    const v1::Dataset& dataset = frame_.target->dataset->dataset;
    const QueryOutcome<volume::HistogramPart> outcome =
        AskHistogram({dataset.dataset_id(), *frame_.parts, frame_.runner->state().NextTurn()},
                     {.max_bin_count = volume::kMaxHistogramBins, .value_range = std::nullopt},
                     *identity_.request, *identity_.cancellation);
    frame_.runner->state().ReportQuery(*identity_.request, outcome.report);
    ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type,
                              wire::ScalarTypeFromProto(dataset.sample_type(), "sample_type"));
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<volume::Label> labels,
                              wire::LabelsFromProto(dataset.labels(), "labels"));
    const SelectedVolume& selected = frame_.target->selected;
    return std::optional<KnownSamples>(
        std::in_place, type, *outcome.result, std::move(labels),
        selected.time.has_value() ? absl::StrCat(" at step ", selected.selection->time_step())
                                  : "");
  }

  void Add(std::size_t surface, const KnownSamples::Note& from) {
    v1::SurfaceNote& note = notes_[surface].emplace_back();
    note.set_surface_index(static_cast<std::int32_t>(surface));
    note.set_reason(from.first);
    note.set_message(from.second);
  }

  absl::Status ExplainUnseen(const KnownSamples& samples, SurfaceSet unseen) {
    ISOSCOPE_ASSIGN_OR_RETURN(const SurfaceSet hidden, Peel(unseen, {}));  // step 2
    const SurfaceSet rest = unseen & ~hidden;
    ISOSCOPE_ASSIGN_OR_RETURN(const SurfaceSet without_cells, FindWithoutCells(rest));
    SurfaceSet outside = rest & ~without_cells;
    if (!spec_.clip.half_spaces.empty() || spec_.clip.box.has_value()) {
      ISOSCOPE_ASSIGN_OR_RETURN(outside, Peel(outside, {.sees_all = true}));
    }
    for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
      const volume::InsideRule& rule = spec_.surfaces[i].rule;
      const std::string name = absl::StrCat(
          samples.NameOf(rule), rule.labels.size() > 1 ? " do" : " does", " not show: ");
      if (hidden.test(i) && IsTransparent(spec_.surfaces[i])) {
        const frame::ColorBy& color_by = *spec_.surfaces[i].color_by;
        Add(i, {v1::SurfaceNote::REASON_TRANSPARENT,
                absl::StrCat(name, "the opacity of its colours, ", color_by.opacity_at_min, " to ",
                             color_by.opacity_at_max, ", is 0 wherever it would")});
      } else if (without_cells.test(i)) {
        Add(i, samples.NoCellNoteOf(rule, spec_.level));
      } else if (outside.test(i)) {
        Add(i, {v1::SurfaceNote::REASON_OUTSIDE_PICTURE,
                absl::StrCat(name,
                             "it lies outside of the picture, or is too small to cover a pixel")});
      } else if (rest.test(i)) {
        Add(i, {v1::SurfaceNote::REASON_CLIPPED,
                absl::StrCat(name, "the clip region cuts all of it away")});
      }
    }
    return absl::OkStatus();
  }

  // Returns true if a surface that shows alone, opaque, is invisible by its own opacity. Others may
  // hide it instead, unless there are none.
  [[nodiscard]] bool IsTransparent(const frame::Surface& surface) const {
    if (!surface.color_by.has_value()) {
      return false;
    }
    const float least =
        std::min(surface.color_by->opacity_at_min, surface.color_by->opacity_at_max);
    const float most = std::max(surface.color_by->opacity_at_min, surface.color_by->opacity_at_max);
    return most == 0 || (least == 0 && spec_.surfaces.size() == 1);
  }

  // Returns those of `surfaces` that show in a drawing without the surfaces that hide them, and
  // those that many others hide: each drawing takes as long as the picture.
  absl::StatusOr<SurfaceSet> Peel(const SurfaceSet& surfaces, const Drawing& how) {
    constexpr int kMaxDrawings = 4;
    SurfaceSet seen;
    for (int drawing = 0; (surfaces & ~seen).any(); ++drawing) {
      if (drawing == kMaxDrawings) {
        return surfaces;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const SurfaceSet now, FindShown(surfaces & ~seen, how));
      if (now.none()) {
        break;
      }
      seen |= now;
    }
    return seen;
  }

  // Step 3. Without culling all blocks are drawn for any band of the drawing.
  absl::StatusOr<SurfaceSet> FindWithoutCells(const SurfaceSet& surfaces) {
    SurfaceSet without;
    if (surfaces.none()) {
      return without;
    }
    const frame::FrameSpec spec =
        SpecOf(surfaces, {.sees_all = true, .is_clipped = false, .culling = frame::Culling::kNone});
    ISOSCOPE_ASSIGN_OR_RETURN(const FrameResult result, Draw(spec, BandsOf(spec), 0));
    const FrameCost cost = CostOf(result);
    std::size_t drawn = 0;
    for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
      if (surfaces.test(i)) {
        without.set(i, cost.total.surfaces[drawn++].triangle_count == 0);
      }
    }
    return without;
  }

  // Returns those of `surfaces` that show in a drawing of them.
  absl::StatusOr<SurfaceSet> FindShown(const SurfaceSet& surfaces, const Drawing& how) {
    const frame::FrameSpec spec = SpecOf(surfaces, how);
    const BandGrid bands = BandsOf(spec);
    SurfaceSet shown;
    for (int i = 0; i < bands.count() && shown != surfaces; ++i) {
      ISOSCOPE_ASSIGN_OR_RETURN(const FrameResult result, Draw(spec, bands, i));
      shown |= ShownIn(surfaces, result);
    }
    return shown;
  }

  SurfaceSet ShownIn(const SurfaceSet& surfaces, const FrameResult& result) {
    const view::PixelRect all{0, 0, result.image.width, result.image.height};
    const SurfaceSet shown = base::RunIn(frame_.runner->state().arena.get(), [&] {
                               return picture::FindContents({.spec = &drawn_spec_,
                                                             .order = drawn_order_,
                                                             .image = &result.image,
                                                             .layers = &result.layers},
                                                            all, /*with_shown=*/true);
                             }).shown;
    SurfaceSet by_index;
    std::size_t drawn = 0;
    for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
      if (surfaces.test(i)) {
        by_index.set(i, shown.test(drawn++));
      }
    }
    return by_index;
  }

  // The frame of some surfaces, opaque and without a quantity.
  [[nodiscard]] frame::FrameSpec SpecOf(const SurfaceSet& surfaces, const Drawing& how) const {
    frame::FrameSpec spec;
    for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
      if (surfaces.test(i)) {
        spec.surfaces.push_back({.rule = spec_.surfaces[i].rule});
      }
    }
    // No drawing has more pixels than the picture, for which memory is reserved.
    spec.viewport = !how.sees_all && spec_.region.has_value() ? spec_.viewport
                                                              : Smaller(frame::ImageSizeOf(spec_));
    if (!how.sees_all && spec_.region.has_value()) {
      spec.region = spec_.region;
    }
    spec.culling = how.culling;
    spec.camera =
        how.sees_all ? view::MakeDefaultCamera(frame_.target->whole.Bounds()) : spec_.camera;
    spec.level = spec_.level;
    if (how.is_clipped) {
      spec.clip = spec_.clip;
    }
    return spec;
  }

  [[nodiscard]] BandGrid BandsOf(const frame::FrameSpec& spec) const {
    return {frame::ImageSizeOf(spec), frame_.band};
  }

  absl::StatusOr<FrameResult> Draw(const frame::FrameSpec& spec, const BandGrid& bands,
                                   int band_index) {
    AskedFrame plain;
    plain.spec = bands.count() == 1 ? spec : SpecOfBand(spec, bands.At(band_index));
    FrameTarget target = *frame_.target;
    target.selected.color_dataset_ids.clear();
    target.order.ties =
        frame::TieRuleOf(frame::DrawnBy(spec, frame_.target->dataset->picture_revision.back_end));
    ISOSCOPE_ASSIGN_OR_RETURN(target.view, target.ViewOf(plain.spec));
    std::vector<FramePart> parts = *frame_.parts;
    drawn_spec_ = plain.spec;
    drawn_order_ = target.order;
    return frame_.runner->Run(identity_, plain, target, &parts);
  }

  const NotedFrame& frame_;
  const frame::FrameSpec& spec_;
  FrameIdentity identity_;
  frame::FrameSpec drawn_spec_;  // of the last drawing
  image::FragmentOrder drawn_order_;
  std::vector<std::vector<v1::SurfaceNote>> notes_;  // by surface
};

}  // namespace

absl::StatusOr<std::vector<v1::SurfaceNote>> NotesOf(const NotedFrame& frame) {
  return NoteSearch(frame).Run();
}

}  // namespace isoscope::server
