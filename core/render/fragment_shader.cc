// The kernel shades a whole list (shade_kernel.h). The list is filled and read in loops of their
// own, so that memory is prefetched one loop before it is used: meshes have left the processor's
// cache since they were drawn. Fragments that the kernel reports as inexact are shaded once more,
// in doubles.

#include "core/render/fragment_shader.h"

#include <array>

#include "core/base/check.h"
#include "core/image/normal_code.h"
#include "core/render/pass_resources.h"

namespace isoscope::render {
namespace {

// Finds the corners of all triangles, then the data at the corners.
void FillVertices(ShadeList* list) {
  ShadeBatch& batch = list->batch;
  for (std::size_t i = 0; i < batch.count; ++i) {
    const ShadedMesh& mesh = *list->meshes[i];
    list->corners[i] = mesh.triangles[list->primitive_ids[i] - mesh.first_primitive_id];
    for (const std::uint32_t vertex : list->corners[i]) {
      __builtin_prefetch(&mesh.positions[vertex]);
      __builtin_prefetch(&mesh.normals[vertex]);
    }
  }
  for (std::size_t i = 0; i < batch.count; ++i) {
    const ShadedMesh& mesh = *list->meshes[i];
    const std::array<std::uint32_t, 3>& corners = list->corners[i];
    for (std::size_t c = 0; c < 3; ++c) {
      const math::Vec3f& position = mesh.positions[corners[c]];
      const mesh::CompactNormal& normal = mesh.normals[corners[c]];
      batch.position[3 * c][i] = position.x;
      batch.position[3 * c + 1][i] = position.y;
      batch.position[3 * c + 2][i] = position.z;
      batch.normal[3 * c][i] = normal.x;
      batch.normal[3 * c + 1][i] = normal.y;
      batch.normal[3 * c + 2][i] = normal.z;
    }
  }
}

}  // namespace

FragmentShader::FragmentShader(const view::View& view, const frame::FrameSpec& spec,
                               const image::FragmentOrder& order, PassResources* resources)
    : view_(view),
      order_(order),
      sends_normals_(spec.sends_normals),
      sends_map_steps_(spec.sends_map_steps),
      map_scales_(MapScalesOf(spec)),
      rays_(view) {
  for (const frame::Surface& surface : spec.surfaces) {
    shade_tables_.push_back(resources->ShadeTableOf(surface.appearance));
  }
}

ShadedMesh FragmentShader::Prepare(const MeshToDraw& item) const {
  const mesh::CompactMesh& mesh = *item.mesh;
  ISOSCOPE_CHECK_LT(item.surface_index, shade_tables_.size());
  ISOSCOPE_CHECK_EQ(mesh.positions.size(), mesh.normals.size());
  const std::optional<MapScale>& scale = map_scales_[item.surface_index];
  ISOSCOPE_CHECK(!scale.has_value() || mesh.values.size() == mesh.positions.size());
  return {.positions = mesh.positions.data(),
          .normals = mesh.normals.data(),
          .triangles = mesh.triangles,
          .owner = order_.OwnerOf(item.surface_index, mesh.block_id),
          .shade_table = shade_tables_[item.surface_index]->data(),
          .map_scale = scale.has_value() ? &*scale : nullptr,
          .mesh = item.mesh};
}

void FragmentShader::Shade(ShadeList* list) const {
  FillVertices(list);
  list->batch.keeps_normals = sends_normals_;
  list->batch.keeps_map_levels = sends_map_steps_;
  if (sends_map_steps_) {
    FillMapLevels(list);
  }
  ComputeShadeSteps(rays_, &list->batch);
  if (sends_normals_) {
    EncodeNormals(list);
  } else {
    LookUpColors(list);
  }
}

// The level is 0 where a fragment carries no step.
void FragmentShader::FillMapLevels(ShadeList* list) const {
  for (std::size_t i = 0; i < list->batch.count; ++i) {
    const ShadedMesh& mesh = *list->meshes[i];
    std::array<float, 3> levels{};
    if (mesh.map_scale != nullptr) {
      const auto map_level_of = [&](std::size_t corner) {
        return mesh.map_scale->MapLevelOf(mesh.mesh->values[list->corners[i][corner]]);
      };
      levels = MapLevelsToMix({map_level_of(0), map_level_of(1), map_level_of(2)});
    }
    for (std::size_t c = 0; c < 3; ++c) {
      list->batch.map_level[c][i] = levels[c];
    }
  }
}

void FragmentShader::EncodeNormals(ShadeList* list) const {
  ShadeBatch& batch = list->batch;
  for (std::size_t i = 0; i < batch.count; ++i) {
    list->colors[i] = image::EncodeNormal({static_cast<double>(batch.mixed_normal[0][i]),
                                           static_cast<double>(batch.mixed_normal[1][i]),
                                           static_cast<double>(batch.mixed_normal[2][i])});
  }
  for (std::size_t k = 0; k < batch.inexact_count; ++k) {
    const std::uint32_t i = batch.inexact[k];
    const SurfacePoint point = PointOf(*list, i);
    list->colors[i] = image::EncodeNormal({point.normal.x, point.normal.y, point.normal.z});
    if (sends_map_steps_) {
      batch.mixed_map_level[i] = MixMapLevels(
          point, {batch.map_level[0][i], batch.map_level[1][i], batch.map_level[2][i]});
    }
  }
  for (std::size_t i = 0; sends_map_steps_ && i < batch.count; ++i) {
    if (list->meshes[i]->map_scale != nullptr) {
      list->colors[i] = CodeOf(list->colors[i], batch.mixed_map_level[i]);
    }
  }
}

void FragmentShader::LookUpColors(ShadeList* list) const {
  ShadeBatch& batch = list->batch;
  for (std::size_t k = 0; k < batch.inexact_count; ++k) {
    const std::uint32_t i = batch.inexact[k];
    batch.step[i] = ShadeStepAt(view_, PointOf(*list, i));
  }
  for (std::size_t i = 0; i < batch.count; ++i) {
    list->colors[i] = list->meshes[i]->shade_table[batch.step[i]];
  }
}

// The point of a fragment, in doubles. Pixel centres lie half-way between whole numbers, so that
// cutting them off is exact.
SurfacePoint FragmentShader::PointOf(const ShadeList& list, std::size_t i) const {
  const ShadedMesh& mesh = *list.meshes[i];
  return SurfacePointAt(view_, *mesh.mesh, list.primitive_ids[i] - mesh.first_primitive_id,
                        static_cast<int>(list.batch.x[i]) - view_.region().x,
                        static_cast<int>(list.batch.y[i]) - view_.region().y);
}

}  // namespace isoscope::render
