// Each class owns OpenGL names, which its destructor deletes, and checks glGetError where calls can
// fail.
//
// A GlStreamBuffer grows by half as much again and is orphaned at each Map, so that the driver can
// still draw with the old contents. GlFramebuffer::ReadInto reads three planes in three calls. It
// then goes through them by stretches of a row, a tile wide. A stretch without an owner is skipped;
// in the others, depth and owner become keys, and their pixels are marked as covered.

#include "core/render/gl_objects.h"

#include <algorithm>
#include <array>
#include <string>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace isoscope::render {
namespace {

absl::StatusOr<GLuint> CompileShader(GLenum stage, const char* source) {
  const GLuint shader = glCreateShader(stage);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  GLint compiled = GL_FALSE;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
  if (compiled == GL_TRUE) {
    return shader;
  }
  std::array<char, 2000> log{};
  glGetShaderInfoLog(shader, static_cast<GLsizei>(log.size()), nullptr, log.data());
  glDeleteShader(shader);
  return absl::InternalError(absl::StrCat("the driver does not compile the ",
                                          stage == GL_VERTEX_SHADER ? "vertex" : "fragment",
                                          " shader: ", log.data()));
}

}  // namespace

absl::Status GlStatus(const char* what) {
  const GLenum first = glGetError();
  if (first == GL_NO_ERROR) [[likely]] {
    return absl::OkStatus();
  }
  // Several errors may be pending. The limit is for a lost context, which reports errors for ever.
  for (int i = 0; i < 100 && glGetError() != GL_NO_ERROR; ++i) {
  }
  if (first == GL_OUT_OF_MEMORY) {
    return absl::ResourceExhaustedError(absl::StrCat("OpenGL ran out of memory: ", what));
  }
  return absl::InternalError(absl::StrCat("OpenGL error 0x", absl::Hex(first), ": ", what));
}

GlStreamBuffer::GlStreamBuffer(GLenum target) : target_(target) { glGenBuffers(1, &name_); }

GlStreamBuffer::~GlStreamBuffer() { glDeleteBuffers(1, &name_); }

void GlStreamBuffer::Bind() const { glBindBuffer(target_, name_); }

absl::StatusOr<void*> GlStreamBuffer::Map(std::size_t size_bytes) {
  ISOSCOPE_CHECK_GT(size_bytes, 0U);
  if (is_mapped_) {
    ISOSCOPE_RETURN_IF_ERROR(Unmap());
  }
  Bind();
  if (size_bytes > capacity_bytes_) {
    // Adds a half, so that a slowly growing size does not reallocate each time.
    const std::size_t capacity = size_bytes + size_bytes / 2;
    glBufferData(target_, static_cast<GLsizeiptr>(capacity), nullptr, GL_STREAM_DRAW);
    ISOSCOPE_RETURN_IF_ERROR(GlStatus("allocate a vertex buffer"));
    capacity_bytes_ = capacity;
  }
  void* data = glMapBufferRange(target_, 0, static_cast<GLsizeiptr>(size_bytes),
                                GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
  if (data == nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(GlStatus("map a vertex buffer"));
    return absl::InternalError("OpenGL can't map a vertex buffer");
  }
  is_mapped_ = true;
  return data;
}

absl::Status GlStreamBuffer::Unmap() {
  is_mapped_ = false;
  Bind();
  if (glUnmapBuffer(target_) != GL_TRUE) {
    return absl::InternalError("OpenGL lost the contents of a vertex buffer");
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<GlProgram>> GlProgram::Make(const char* vertex_source,
                                                           const char* fragment_source) {
  ISOSCOPE_ASSIGN_OR_RETURN(const GLuint vertex, CompileShader(GL_VERTEX_SHADER, vertex_source));
  absl::StatusOr<GLuint> fragment = CompileShader(GL_FRAGMENT_SHADER, fragment_source);
  if (!fragment.ok()) {
    glDeleteShader(vertex);
    return fragment.status();
  }
  std::unique_ptr<GlProgram> program(new GlProgram);
  program->name_ = glCreateProgram();
  glAttachShader(program->name_, vertex);
  glAttachShader(program->name_, *fragment);
  glLinkProgram(program->name_);
  glDeleteShader(vertex);
  glDeleteShader(*fragment);
  GLint linked = GL_FALSE;
  glGetProgramiv(program->name_, GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE) {
    std::array<char, 2000> log{};
    glGetProgramInfoLog(program->name_, static_cast<GLsizei>(log.size()), nullptr, log.data());
    return absl::InternalError(absl::StrCat("the driver does not link the shaders: ", log.data()));
  }
  return program;
}

GlProgram::~GlProgram() { glDeleteProgram(name_); }

GLint GlProgram::Uniform(const char* uniform) const {
  const GLint location = glGetUniformLocation(name_, uniform);
  ISOSCOPE_CHECK_GE(location, 0);
  return location;
}

absl::StatusOr<std::unique_ptr<GlFramebuffer>> GlFramebuffer::Make(int width, int height) {
  ISOSCOPE_CHECK_GE(width, 1);
  ISOSCOPE_CHECK_GE(height, 1);
  GLint max_side = 0;
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &max_side);
  std::array<GLint, 2> max_viewport{};
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, max_viewport.data());
  const GLint max_width = std::min(max_side, max_viewport[0]);
  const GLint max_height = std::min(max_side, max_viewport[1]);
  if (width > max_width || height > max_height) {
    return absl::ResourceExhaustedError(absl::StrCat("a picture of ", width, " x ", height,
                                                     " pixels; this OpenGL draws at most ",
                                                     max_width, " x ", max_height));
  }
  std::unique_ptr<GlFramebuffer> made(new GlFramebuffer);
  made->width_ = width;
  made->height_ = height;
  glGenFramebuffers(1, &made->framebuffer_);
  glBindFramebuffer(GL_FRAMEBUFFER, made->framebuffer_);
  const auto attach = [width, height](GLenum attachment, GLenum format, GLuint* name) {
    glGenRenderbuffers(1, name);
    glBindRenderbuffer(GL_RENDERBUFFER, *name);
    glRenderbufferStorage(GL_RENDERBUFFER, format, width, height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, *name);
  };
  attach(GL_COLOR_ATTACHMENT0, GL_RGBA8, &made->color_);
  attach(GL_COLOR_ATTACHMENT1, GL_R32UI, &made->owner_);
  attach(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT32F, &made->depth_);
  const std::string what = absl::StrCat("make a picture of ", width, " x ", height, " pixels");
  ISOSCOPE_RETURN_IF_ERROR(GlStatus(what.c_str()));
  constexpr std::array<GLenum, 2> kTargets{GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
  glDrawBuffers(static_cast<GLsizei>(kTargets.size()), kTargets.data());
  const GLenum state = glCheckFramebufferStatus(GL_FRAMEBUFFER);
  if (state != GL_FRAMEBUFFER_COMPLETE) {
    return absl::ResourceExhaustedError(
        absl::StrCat("OpenGL can't ", what, " (framebuffer status 0x", absl::Hex(state), ")"));
  }
  return made;
}

GlFramebuffer::~GlFramebuffer() {
  glDeleteFramebuffers(1, &framebuffer_);
  for (const GLuint renderbuffer : {color_, owner_, depth_}) {
    glDeleteRenderbuffers(1, &renderbuffer);
  }
}

void GlFramebuffer::BindAndClear(const view::Region& region) const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glViewport(0, 0, width_, height_);
  const bool is_whole = region.width_px == width_ && region.height_px == height_;
  (is_whole ? glDisable : glEnable)(GL_SCISSOR_TEST);
  glScissor(region.x, region.y, region.width_px, region.height_px);
  constexpr std::array<GLfloat, 4> kTransparent{0, 0, 0, 0};
  constexpr std::array<GLuint, 4> kBackground{image::kNoOwner, 0, 0, 0};
  glClearBufferfv(GL_COLOR, 0, kTransparent.data());
  glClearBufferuiv(GL_COLOR, 1, kBackground.data());
  glClearBufferfv(GL_DEPTH, 0, &image::kFarDepth);
}

absl::Status GlFramebuffer::ReadInto(const view::Region& region, GlReadback* scratch,
                                     image::FrameImage* image) const {
  const int width = region.width_px;
  const int height = region.height_px;
  ISOSCOPE_CHECK_EQ(image->width, width);
  ISOSCOPE_CHECK_EQ(image->height, height);
  scratch->colors.resize(image->pixel_count());
  scratch->owners.resize(image->pixel_count());
  scratch->depths.resize(image->pixel_count());
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_);
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glReadBuffer(GL_COLOR_ATTACHMENT0);
  glReadPixels(region.x, region.y, width, height, GL_RGBA, GL_UNSIGNED_BYTE,
               scratch->colors.data());
  glReadBuffer(GL_COLOR_ATTACHMENT1);
  glReadPixels(region.x, region.y, width, height, GL_RED_INTEGER, GL_UNSIGNED_INT,
               scratch->owners.data());
  glReadPixels(region.x, region.y, width, height, GL_DEPTH_COMPONENT, GL_FLOAT,
               scratch->depths.data());
  ISOSCOPE_RETURN_IF_ERROR(GlStatus("read the picture back"));

  constexpr int kTilePx = image::TileSet::kTilePx;
  for (int y = 0; y < height; ++y) {
    for (int begin_x = 0; begin_x < width; begin_x += kTilePx) {
      const std::size_t begin = image->IndexOf(begin_x, y);
      const std::size_t end = begin + static_cast<std::size_t>(std::min(kTilePx, width - begin_x));
      std::uint32_t all_owners = image::kNoOwner;
      for (std::size_t i = begin; i < end; ++i) {
        all_owners &= scratch->owners[i];
      }
      if (all_owners == image::kNoOwner) {
        continue;
      }
      image->touched.Insert(begin_x / kTilePx, y / kTilePx);
      std::uint32_t covered = 0;
      for (std::size_t i = begin; i < end; ++i) {
        image->keys[i] = image::FragmentKey(scratch->depths[i], scratch->owners[i]);
        image->colors[i] = scratch->colors[i];
        covered |= std::uint32_t{image->keys[i] != image::kBackgroundKey} << (i - begin);
      }
      image->CoveredOf(begin_x / kTilePx, y / kTilePx)[static_cast<std::size_t>(y % kTilePx)] =
          static_cast<std::uint16_t>(covered);
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::render
