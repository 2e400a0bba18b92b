// OpenGL objects that free themselves. All of them are for the GL thread only, with the context
// current from construction to destruction.

#ifndef ISOSCOPE_CORE_RENDER_GL_OBJECTS_H_
#define ISOSCOPE_CORE_RENDER_GL_OBJECTS_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include <epoxy/gl.h>

#include "core/image/frame_image.h"
#include "core/view/camera.h"

namespace isoscope::render {

// Returns the error that glGetError has for the calls so far: RESOURCE_EXHAUSTED for
// GL_OUT_OF_MEMORY, INTERNAL otherwise. `what`: "draw 17 blocks".
absl::Status GlStatus(const char* what);

// A buffer that is rewritten often, and keeps the largest size that it had.
class GlStreamBuffer {
 public:
  explicit GlStreamBuffer(GLenum target);
  ~GlStreamBuffer();
  GlStreamBuffer(const GlStreamBuffer&) = delete;
  GlStreamBuffer& operator=(const GlStreamBuffer&) = delete;

  [[nodiscard]] GLuint name() const { return name_; }
  void Bind() const;
  // Binds the buffer and maps `size_bytes` (> 0) for writing. The old contents are lost, except for
  // draws that were issued with them. RESOURCE_EXHAUSTED if the driver has no memory.
  absl::StatusOr<void*> Map(std::size_t size_bytes);
  // Ends writing. INTERNAL if the driver has lost the contents.
  absl::Status Unmap();

 private:
  const GLenum target_;
  GLuint name_ = 0;
  std::size_t capacity_bytes_ = 0;
  bool is_mapped_ = false;  // still, if an error came between Map and Unmap
};

// A linked vertex and fragment shader.
class GlProgram {
 public:
  // Returns INTERNAL, with the compiler's log, if a shader does not compile.
  static absl::StatusOr<std::unique_ptr<GlProgram>> Make(const char* vertex_source,
                                                         const char* fragment_source);
  ~GlProgram();
  GlProgram(const GlProgram&) = delete;
  GlProgram& operator=(const GlProgram&) = delete;

  [[nodiscard]] GLuint name() const { return name_; }
  [[nodiscard]] GLint Uniform(const char* uniform) const;

 private:
  GlProgram() = default;
  GLuint name_ = 0;
};

// The memory that the planes of a GlFramebuffer are read into, reused from picture to picture.
struct GlReadback {
  std::vector<image::Rgba8> colors;
  std::vector<std::uint32_t> owners;
  std::vector<float> depths;
};

// Colour (RGBA8), owner (R32UI) and depth (32-bit float) of one size.
class GlFramebuffer {
 public:
  // Returns RESOURCE_EXHAUSTED, with the driver's limit, if the size is too large for the driver.
  static absl::StatusOr<std::unique_ptr<GlFramebuffer>> Make(int width, int height);
  ~GlFramebuffer();
  GlFramebuffer(const GlFramebuffer&) = delete;
  GlFramebuffer& operator=(const GlFramebuffer&) = delete;

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

  // Makes it the target of drawing, sets the viewport to its size, and clears the pixels of
  // `region`. No other pixel is drawn. REQUIRES: the region lies in the framebuffer.
  void BindAndClear(const view::Region& region) const;
  // Reads the pixels of `region`. Its first row becomes row 0 of the image. Touches the tiles in
  // which a block owns a pixel.
  // REQUIRES: `image` has the region's size and is all background.
  absl::Status ReadInto(const view::Region& region, GlReadback* scratch,
                        image::FrameImage* image) const;

 private:
  GlFramebuffer() = default;

  int width_ = 0;
  int height_ = 0;
  GLuint framebuffer_ = 0;
  GLuint color_ = 0;
  GLuint owner_ = 0;
  GLuint depth_ = 0;
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_GL_OBJECTS_H_
