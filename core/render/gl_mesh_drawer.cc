// A picture in four steps:
//
// 1. Items are sorted from the highest owner (surface, then block) to the lowest. With the depth
//    test GL_LEQUAL the last of two equal depths stays, so the lowest owner wins.
// 2. The list is cut into chunks (gl_mesh_chunk). `poll` is asked before each chunk, so a cancelled
//    frame ends soon.
// 3. DrawChunk writes the six buffers of a chunk and makes one draw call. The fragment shader drops
//    fragments outside the item's rectangle and open pixels, clamps the depth, and shades; or it
//    writes the code of the normal (image::EncodeNormal) as a colour.
// 4. The planes are read back. The picture is drawn upside down, so that row 0 of the framebuffer
//    is row 0 of the image.
//
// A region is drawn into a framebuffer of the whole viewport, through a scissor, and only the
// region is read back. So its pixels equal those of the whole. A viewport of another origin would
// round vertices differently.

#include "core/render/gl_mesh_drawer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"

namespace isoscope::render {
namespace {

constexpr GLuint kPositionAttribute = 0;
constexpr GLuint kNormalAttribute = 1;
constexpr GLuint kSlotAttribute = 2;

// Both shaders follow a head with the version, CLIPS if the region clips something, and NORMALS if
// colours are codes of normals.
constexpr const char* kVertexShader = R"(
layout(location = 0) in vec3 position;  // index space
layout(location = 1) in vec3 normal;    // world space
layout(location = 2) in uint slot;
uniform vec3 center;
uniform mat4 clip_from_centered;
invariant gl_Position;
out vec3 fragment_normal;
flat out uint fragment_slot;
#ifdef CLIPS
out vec3 fragment_position;  // relative to the centre
#endif
void main() {
#ifdef CLIPS
  fragment_position = position - center;
#endif
  gl_Position = clip_from_centered * vec4(position - center, 1.0);
  fragment_normal = normal;
  fragment_slot = slot;
}
)";

constexpr const char* kFragmentShader = R"(
in vec3 fragment_normal;
flat in uint fragment_slot;
// Each slot has two texels. The first one holds the owner, the bits of the nearest depth, the first
// pixel (x | y << 16) and the end pixel. The second one holds, of the mask, the first word, the
// shift, the first cell (column | row << 16), and the number of columns and rows.
uniform usamplerBuffer blocks;
uniform usamplerBuffer masks;
const uint kNoMask = 0xffffffffu;
#ifndef NORMALS
// The direction from the eye to the pixel at p is ray_origin + ray_x * p.x + ray_y * p.y.
uniform vec3 ray_origin;
uniform vec3 ray_x;
uniform vec3 ray_y;
uniform vec4 base_color;
uniform vec4 shading;  // ambient, diffuse, specular, shininess
#endif
#ifdef CLIPS
in vec3 fragment_position;
uniform int half_space_count;
uniform vec4 half_spaces[12];  // normal and offset, relative to the centre
#endif
uniform ivec2 region_origin;  // the picture's first pixel in the viewport
layout(location = 0) out vec4 color;
layout(location = 1) out uint owner;
#ifdef NORMALS
// As image::EncodeNormal, but for the rounding of floats.
vec4 encode(vec3 v) {
  float sum = abs(v.x) + abs(v.y) + abs(v.z);
  if (!(dot(v, v) > 1e-12)) {
    return vec4(128.0, 0.0, 128.0, 0.0) / 255.0;
  }
  vec2 p = v.xy / sum;
  if (v.z < 0.0) {
    p = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1.0 : 1.0, p.y < 0.0 ? -1.0 : 1.0);
  }
  uvec2 code = uvec2(ivec2(floor(clamp(p, -1.0, 1.0) * 32767.0 + 0.5))) & 0xffffu;
  return vec4(code.x >> 8, code.x & 0xffu, code.y >> 8, code.y & 0xffu) / 255.0;
}
#endif
void main() {
  uvec4 block = texelFetch(blocks, int(2u * fragment_slot));
  uvec4 mask = texelFetch(blocks, int(2u * fragment_slot + 1u));
  uvec2 pixel = uvec2(ivec2(gl_FragCoord.xy) - region_origin);
  uvec2 first = uvec2(block.z & 0xffffu, block.z >> 16);
  uvec2 end = uvec2(block.w & 0xffffu, block.w >> 16);
  if (any(lessThan(pixel, first)) || any(greaterThanEqual(pixel, end))) {
    discard;
  }
#ifdef CLIPS
  for (int i = 0; i < half_space_count; ++i) {
    if (dot(half_spaces[i].xyz, fragment_position) < half_spaces[i].w) {
      discard;
    }
  }
#endif
  if (mask.x != kNoMask) {
    // A cell left of or above the first wraps around to a very large one.
    uvec2 cell = (pixel >> mask.y) - uvec2(mask.z & 0xffffu, mask.z >> 16);
    uvec2 cells = uvec2(mask.w & 0xffffu, mask.w >> 16);
    if (any(greaterThanEqual(cell, cells))) {
      discard;
    }
    uint bit = cell.x + cell.y * cells.x;
    uint word = texelFetch(masks, int(mask.x + (bit >> 5))).x;
    if ((word >> (bit & 31u) & 1u) == 0u) {
      discard;
    }
  }
  gl_FragDepth = clamp(gl_FragCoord.z, uintBitsToFloat(block.y), 1.0);
  owner = block.x;
#ifdef NORMALS
  color = encode(fragment_normal);
#else
  vec3 ray = ray_origin + ray_x * gl_FragCoord.x + ray_y * gl_FragCoord.y;
  float normal_squared = dot(fragment_normal, fragment_normal);
  float facing = 1.0;
  if (normal_squared > 1e-12) {
    facing = abs(dot(fragment_normal, ray)) * inversesqrt(normal_squared * dot(ray, ray));
    facing = clamp(facing, 0.0, 1.0);
  }
  float diffuse = shading.x + shading.y * facing;
  float highlight = shading.z * pow(max(facing, 1e-6), shading.w);
  color = vec4(clamp(base_color.rgb * diffuse + highlight, 0.0, 1.0), base_color.a);
#endif
}
)";

void SetVec3(GLint location, const math::Vec3d& v) {
  glUniform3f(location, static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z));
}

absl::StatusOr<std::unique_ptr<GlProgram>> MakeProgram(bool clips, bool sends_normals) {
  const std::string head = absl::StrCat("#version 330 core\n", clips ? "#define CLIPS\n" : "",
                                        sends_normals ? "#define NORMALS\n" : "");
  return GlProgram::Make(absl::StrCat(head, kVertexShader).c_str(),
                         absl::StrCat(head, kFragmentShader).c_str());
}

// Returns the point that positions are relative to in the shaders.
math::Vec3d CenterOf(const view::View& view) {
  const math::Index3& dims = view.geometry().sample_dims;
  return {std::floor(static_cast<double>(dims.x) / 2), std::floor(static_cast<double>(dims.y) / 2),
          std::floor(static_cast<double>(dims.z) / 2)};
}

}  // namespace

absl::StatusOr<std::unique_ptr<GlMeshDrawer>> GlMeshDrawer::Make(
    std::shared_ptr<image::FrameImagePool> images) {
  std::unique_ptr<GlMeshDrawer> made(new GlMeshDrawer);
  made->images_ = std::move(images);
  ISOSCOPE_ASSIGN_OR_RETURN(made->programs_[0][0],
                            MakeProgram(/*clips=*/false, /*sends_normals=*/false));
  made->positions_ = std::make_unique<GlStreamBuffer>(GL_ARRAY_BUFFER);
  made->normals_ = std::make_unique<GlStreamBuffer>(GL_ARRAY_BUFFER);
  made->slots_ = std::make_unique<GlStreamBuffer>(GL_ARRAY_BUFFER);
  made->indices_ = std::make_unique<GlStreamBuffer>(GL_ELEMENT_ARRAY_BUFFER);
  made->blocks_ = std::make_unique<GlStreamBuffer>(GL_TEXTURE_BUFFER);
  made->masks_ = std::make_unique<GlStreamBuffer>(GL_TEXTURE_BUFFER);

  GLint max_texels = 0;
  glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &max_texels);
  made->max_texels_ = static_cast<std::size_t>(max_texels);

  glGenVertexArrays(1, &made->vertex_array_);
  glBindVertexArray(made->vertex_array_);
  made->positions_->Bind();
  glVertexAttribPointer(kPositionAttribute, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
  made->normals_->Bind();
  glVertexAttribPointer(kNormalAttribute, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
  made->slots_->Bind();
  glVertexAttribIPointer(kSlotAttribute, 1, GL_UNSIGNED_INT, 0, nullptr);
  for (const GLuint attribute : {kPositionAttribute, kNormalAttribute, kSlotAttribute}) {
    glEnableVertexAttribArray(attribute);
  }
  made->indices_->Bind();

  glGenTextures(1, &made->blocks_texture_);
  glActiveTexture(GL_TEXTURE0);
  made->blocks_->Bind();
  glBindTexture(GL_TEXTURE_BUFFER, made->blocks_texture_);
  glTexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32UI, made->blocks_->name());
  glGenTextures(1, &made->masks_texture_);
  glActiveTexture(GL_TEXTURE1);
  made->masks_->Bind();
  glBindTexture(GL_TEXTURE_BUFFER, made->masks_texture_);
  glTexBuffer(GL_TEXTURE_BUFFER, GL_R32UI, made->masks_->name());

  glDisable(GL_DITHER);
  glDisable(GL_BLEND);
  glDisable(GL_MULTISAMPLE);
  glDisable(GL_CULL_FACE);
  glDisable(GL_SCISSOR_TEST);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LEQUAL);
  ISOSCOPE_RETURN_IF_ERROR(GlStatus("set up drawing"));
  return made;
}

GlMeshDrawer::~GlMeshDrawer() {
  glDeleteTextures(1, &blocks_texture_);
  glDeleteTextures(1, &masks_texture_);
  glDeleteVertexArrays(1, &vertex_array_);
}

absl::Status GlMeshDrawer::UseProgram(const view::Clipper& clipper, bool sends_normals,
                                      const view::View& view) {
  std::unique_ptr<GlProgram>& program = programs_[clipper.empty() ? 0 : 1][sends_normals ? 1 : 0];
  if (program == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(program, MakeProgram(!clipper.empty(), sends_normals));
  }
  program_ = program.get();
  glUseProgram(program_->name());
  if (clipper.empty()) {
    return absl::OkStatus();
  }
  const math::Vec3d center = CenterOf(view);
  std::vector<float> values;
  for (const view::HalfSpace& half_space : clipper.half_spaces()) {
    for (int axis = 0; axis < 3; ++axis) {
      values.push_back(static_cast<float>(half_space.normal[axis]));
    }
    values.push_back(static_cast<float>(half_space.offset - math::Dot(half_space.normal, center)));
  }
  const auto count = static_cast<GLsizei>(clipper.half_spaces().size());
  glUniform1i(program_->Uniform("half_space_count"), count);
  glUniform4fv(program_->Uniform("half_spaces"), count, values.data());
  return absl::OkStatus();
}

void GlMeshDrawer::SetView(const view::View& view, bool sends_normals) {
  // Positions are relative to the volume's centre, near which cameras look. So the matrix has no
  // large translation that cancels in floats. The centre has whole coordinates, so the subtraction
  // is exact for all but the vertices near index 0.
  const math::Vec3d center = CenterOf(view);
  // The picture is drawn upside down: row 0 of the framebuffer is the top of the image.
  math::Mat4d flip;
  flip.At(1, 1) = -1;
  const math::Mat4d clip_from_centered =
      flip * view.clip_from_index() * math::MakeAffine(math::Mat3d{}, center);
  std::array<float, 16> matrix{};
  std::transform(clip_from_centered.m.begin(), clip_from_centered.m.end(), matrix.begin(),
                 [](double value) { return static_cast<float>(value); });

  SetVec3(program_->Uniform("center"), center);
  glUniformMatrix4fv(program_->Uniform("clip_from_centered"), 1, GL_FALSE, matrix.data());
  glUniform2i(program_->Uniform("region_origin"), view.region().x, view.region().y);
  glUniform1i(program_->Uniform("blocks"), 0);
  glUniform1i(program_->Uniform("masks"), 1);
  if (!sends_normals) {
    SetRays(view);
  }
}

void GlMeshDrawer::SetRays(const view::View& view) {
  const view::LinearVec3d& direction = view.image_plane().rays.direction;
  SetVec3(program_->Uniform("ray_origin"), direction.at);
  SetVec3(program_->Uniform("ray_x"), direction.per_x);
  SetVec3(program_->Uniform("ray_y"), direction.per_y);
}

void GlMeshDrawer::SetAppearance(const frame::Appearance& appearance) {
  const image::Rgba8& base = appearance.base_color;
  glUniform4f(program_->Uniform("base_color"), static_cast<float>(base.r) / 255.0F,
              static_cast<float>(base.g) / 255.0F, static_cast<float>(base.b) / 255.0F,
              static_cast<float>(base.a) / 255.0F);
  glUniform4f(program_->Uniform("shading"), appearance.ambient,
              appearance.diffuse.value_or(1.0F - appearance.ambient), appearance.specular,
              appearance.shininess);
}

absl::StatusOr<image::FrameImage> GlMeshDrawer::Draw(
    const view::View& view, std::span<const frame::Surface> surfaces, const view::Clipper& clipper,
    const image::FragmentOrder& order, bool sends_normals, std::vector<DrawItem> items,
    absl::FunctionRef<absl::Status()> poll) {
  ISOSCOPE_RETURN_IF_ERROR(poll());
  std::sort(items.begin(), items.end(), [](const DrawItem& a, const DrawItem& b) {
    return std::pair(a.surface_index, a.mesh->block_id) >
           std::pair(b.surface_index, b.mesh->block_id);
  });
  const int width = view.viewport().width_px;
  const int height = view.viewport().height_px;
  if (framebuffer_ == nullptr || framebuffer_->width() != width ||
      framebuffer_->height() != height) {
    framebuffer_.reset();
    ISOSCOPE_ASSIGN_OR_RETURN(framebuffer_, GlFramebuffer::Make(width, height));
  }
  framebuffer_->BindAndClear(view.region());
  ISOSCOPE_RETURN_IF_ERROR(UseProgram(clipper, sends_normals, view));
  SetView(view, sends_normals);

  std::size_t begin = 0;
  while (begin < items.size()) {
    ISOSCOPE_RETURN_IF_ERROR(poll());
    const std::uint32_t surface_index = items[begin].surface_index;
    if (!sends_normals) {
      SetAppearance(surfaces[surface_index].appearance);
    }
    const std::span<const DrawItem> rest = std::span(items).subspan(begin);
    const ChunkSize chunk = NextChunk(rest, max_texels_);
    if (chunk.mask_words > max_texels_) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the mask of block ", items[begin].mesh->block_id, " has ", chunk.mask_words,
                       " words; this OpenGL takes at most ", max_texels_));
    }
    ISOSCOPE_RETURN_IF_ERROR(DrawChunk(rest.first(chunk.items), chunk, order));
    begin += chunk.items;
  }
  ISOSCOPE_RETURN_IF_ERROR(poll());
  const view::Region& region = view.region();
  image::FrameImage image = images_->Take(region.width_px, region.height_px);
  ISOSCOPE_RETURN_IF_ERROR(framebuffer_->ReadInto(region, &readback_, &image));
  return image;
}

absl::Status GlMeshDrawer::DrawChunk(std::span<const DrawItem> items, const ChunkSize& size,
                                     const image::FragmentOrder& order) {
  glBindVertexArray(vertex_array_);
  ISOSCOPE_ASSIGN_OR_RETURN(void* positions, positions_->Map(size.vertices * sizeof(math::Vec3f)));
  ISOSCOPE_ASSIGN_OR_RETURN(void* normals, normals_->Map(size.vertices * sizeof(math::Vec3f)));
  ISOSCOPE_ASSIGN_OR_RETURN(void* slots, slots_->Map(size.vertices * sizeof(std::uint32_t)));
  ISOSCOPE_ASSIGN_OR_RETURN(void* indices, indices_->Map(size.indices * sizeof(std::uint32_t)));
  ISOSCOPE_ASSIGN_OR_RETURN(void* blocks, blocks_->Map(items.size() * sizeof(BlockTexel)));
  // There is one word more, because an empty buffer can't be mapped.
  ISOSCOPE_ASSIGN_OR_RETURN(void* masks,
                            masks_->Map((size.mask_words + 1) * sizeof(std::uint32_t)));
  WriteChunk(items, order,
             {.positions = static_cast<math::Vec3f*>(positions),
              .normals = static_cast<math::Vec3f*>(normals),
              .slots = static_cast<std::uint32_t*>(slots),
              .indices = static_cast<std::uint32_t*>(indices),
              .blocks = static_cast<BlockTexel*>(blocks),
              .masks = static_cast<std::uint32_t*>(masks)});
  for (GlStreamBuffer* buffer : {positions_.get(), normals_.get(), slots_.get(), indices_.get(),
                                 blocks_.get(), masks_.get()}) {
    ISOSCOPE_RETURN_IF_ERROR(buffer->Unmap());
  }
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_BUFFER, blocks_texture_);
  glActiveTexture(GL_TEXTURE1);
  glBindTexture(GL_TEXTURE_BUFFER, masks_texture_);
  glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(size.indices), GL_UNSIGNED_INT, nullptr);
  return GlStatus("draw a chunk of blocks");
}

}  // namespace isoscope::render
