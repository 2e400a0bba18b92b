// The stages, in this order:
//
//   0. The contents are found. Then deferred shading turns normals into colours, if the agents sent
//      normals instead.
//   1. Ambient occlusion darkens the drawn pixels, in all samples and in the margin.
//   2. Silhouettes are drawn over them.
//   3. Translucent layers are blended over both: they neither cast nor receive occlusion.
//   4. Samples: each pixel becomes the mean of its own. A region loses its margin.

#include "server/picture/picture_finish.h"

#include <optional>
#include <utility>

#include "core/base/check.h"
#include "core/picture/ambient_occlusion.h"
#include "core/picture/deferred_shading.h"
#include "core/picture/downsample.h"
#include "core/picture/layer_blending.h"
#include "core/picture/silhouette.h"

namespace isoscope::server {
namespace {

// The pixels of the drawn window that the picture is made of.
view::PixelRect PictureRectOf(const frame::FrameSpec& spec, const frame::DrawnWindow& window) {
  const view::Viewport size = frame::ImageSizeOf(spec);
  const int side = spec.effects.samples_per_side;
  return {.begin_x = window.begin_x,
          .begin_y = window.begin_y,
          .end_x = window.begin_x + side * size.width_px,
          .end_y = window.begin_y + side * size.height_px};
}

}  // namespace

FinishedPicture FinishPicture(const PictureSetup& setup, image::FrameImage* drawn) {
  const frame::FrameSpec& spec = *setup.spec;
  const frame::DrawnWindow& window = *setup.window;
  ISOSCOPE_CHECK_EQ(drawn->width, window.image_size().width_px);
  ISOSCOPE_CHECK_EQ(drawn->height, window.image_size().height_px);
  const int samples_per_side = spec.effects.samples_per_side;
  FinishedPicture finished;
  std::optional<picture::DeferredShader> shader;
  if (picture::NeedsDeferredShading(spec)) {
    shader.emplace(spec, *setup.drawn_view, setup.order);
  }
  finished.contents =
      picture::FindContents({.spec = &spec,
                             .order = setup.order,
                             .image = drawn,
                             .layers = setup.layers,
                             .shader = shader ? &*shader : nullptr},
                            PictureRectOf(spec, window), setup.finds_shown_surfaces);
  if (shader.has_value()) {
    shader->ShadeImage(drawn);
    for (image::FrameImage* layer_image : setup.layers->MutableLayerImages()) {
      shader->ShadeImage(layer_image);
    }
  } else {
    picture::ColorCapsWithoutSamples(spec, drawn);
  }
  if (spec.effects.ambient_occlusion.has_value()) {
    picture::ShadeAmbientOcclusion(*spec.effects.ambient_occlusion, *setup.drawn_view,
                                   samples_per_side, drawn);
  }
  if (spec.effects.silhouette.has_value()) {
    picture::DrawSilhouettes(*spec.effects.silhouette, *setup.drawn_view, setup.order,
                             samples_per_side, drawn);
  }
  finished.truncated_pixel_count =
      picture::BlendLayers(*setup.layers, spec, PictureRectOf(spec, window), drawn);
  if (spec.output.any_drawn_plane()) {
    picture::ShowNearestKeys(*setup.layers, drawn);
  }
  if (window.is_picture_of(spec)) {
    finished.image = std::move(*drawn);
    return finished;
  }
  const view::Viewport size = frame::ImageSizeOf(spec);
  finished.image = setup.images->Take(size.width_px, size.height_px);
  if (samples_per_side > 1) {
    picture::Downsample(*drawn,
                        {.samples_per_side = samples_per_side,
                         .begin_x = window.begin_x,
                         .begin_y = window.begin_y},
                        spec.background_color, &finished.image);
  } else {
    picture::Crop(*drawn, window.begin_x, window.begin_y, &finished.image);
  }
  return finished;
}

}  // namespace isoscope::server
