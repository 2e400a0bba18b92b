// A PNG over an opaque background has three channels, so its head is known before its pixels. Its
// rows are encoded in whole stripes (image::PngRowWriter); rows of a stripe that is not complete
// wait for the next row of bands. A JPEG takes rows as they come (image::JpegRowWriter). A PNG over
// another background waits as pixels: its last pixel may decide that it has four channels.

#include "server/picture/band_joiner.h"

#include <algorithm>
#include <cstring>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"

namespace isoscope::server {
namespace {

std::size_t Times(int a, int b) {
  return static_cast<std::size_t>(a) * static_cast<std::size_t>(b);
}

}  // namespace

BandJoiner::BandJoiner(const frame::FrameSpec& spec, bool is_encoded_by_rows)
    : spec_(spec), size_(frame::ImageSizeOf(spec)) {
  const frame::OutputSpec& wanted = spec.output;
  const std::size_t pixels = Times(size_.width_px, size_.height_px);
  if (is_encoded_by_rows && wanted.image_format == frame::ImageFormat::kJpeg) {
    jpeg_rows_.emplace(size_.width_px, size_.height_px, spec.background_color, wanted.jpeg_quality);
  } else if (is_encoded_by_rows && wanted.image_format == frame::ImageFormat::kPng &&
             spec.background_color.a == 255) {
    png_rows_.emplace(size_.width_px, size_.height_px, /*is_opaque=*/true);
    encoded_rows_.push_back(png_rows_->Begin());
  } else if (wanted.image_format == frame::ImageFormat::kRgba8) {
    output_.image.resize(pixels * frame::kRgba8Bytes);
  } else if (wanted.image_format != frame::ImageFormat::kNone) {
    pixels_.resize(pixels);
  }
  output_.depth.resize(wanted.depth ? pixels * frame::kDepthBytes : 0);
  output_.surface_index.resize(wanted.surface_index ? pixels * frame::kSurfaceIndexBytes : 0);
  output_.position.resize(wanted.position ? pixels * frame::kPositionBytes : 0);
  output_.normal.resize(wanted.normal ? pixels * frame::kNormalBytes : 0);
}

void BandJoiner::AddPicture(const view::Region& band, const image::FrameImage& image) {
  ISOSCOPE_CHECK_EQ(image.width, band.width_px);
  ISOSCOPE_CHECK_EQ(image.height, band.height_px);
  if (spec_.output.image_format == frame::ImageFormat::kNone) {
    return;
  }
  const bool is_raw = spec_.output.image_format == frame::ImageFormat::kRgba8;
  const bool shows_background = is_raw || png_rows_.has_value();
  if (is_by_rows()) {
    pixels_.resize(
        std::max(pixels_.size(), Times(size_.width_px, band.y + band.height_px - begin_row_)));
  }
  std::vector<image::Rgba8> row(static_cast<std::size_t>(band.width_px));
  for (int y = 0; y < band.height_px; ++y) {
    const auto from = image.colors.begin() + static_cast<std::ptrdiff_t>(image.IndexOf(0, y));
    std::copy(from, from + band.width_px, row.begin());
    for (image::Rgba8& color : row) {
      color = shows_background && color.a == 0 ? spec_.background_color : color;
      is_opaque_ = is_opaque_ && color.a == 255;
    }
    const std::size_t to =
        Times(size_.width_px, band.y + y - begin_row_) + static_cast<std::size_t>(band.x);
    if (is_raw) {
      std::memcpy(output_.image.data() + to * sizeof(image::Rgba8), row.data(),
                  row.size() * sizeof(image::Rgba8));
    } else {
      std::copy(row.begin(), row.end(), pixels_.begin() + static_cast<std::ptrdiff_t>(to));
    }
  }
  if (band.x + band.width_px == size_.width_px) {
    complete_row_count_ = band.y + band.height_px;
  }
}

void BandJoiner::AddPlanes(const view::Region& band, const FrameOutput& planes) {
  AddPlane(band, frame::kDepthBytes, planes.depth, &output_.depth);
  AddPlane(band, frame::kSurfaceIndexBytes, planes.surface_index, &output_.surface_index);
  AddPlane(band, frame::kPositionBytes, planes.position, &output_.position);
  AddPlane(band, frame::kNormalBytes, planes.normal, &output_.normal);
}

void BandJoiner::AddPlane(const view::Region& band, std::size_t pixel_bytes,
                          const std::string& from, std::string* to) const {
  if (to->empty()) {
    return;
  }
  ISOSCOPE_CHECK_EQ(from.size(), Times(band.width_px, band.height_px) * pixel_bytes);
  const std::size_t row_bytes = static_cast<std::size_t>(band.width_px) * pixel_bytes;
  for (int y = 0; y < band.height_px; ++y) {
    const std::size_t pixel = Times(size_.width_px, band.y + y) + static_cast<std::size_t>(band.x);
    std::memcpy(to->data() + pixel * pixel_bytes, from.data() + Times(y, 1) * row_bytes, row_bytes);
  }
}

int BandJoiner::RowsToEncode() const {
  const int waiting = complete_row_count_ - begin_row_;
  if (jpeg_rows_.has_value() || complete_row_count_ == size_.height_px) {
    return waiting;
  }
  const int stripe_rows = image::PngRowWriter::RowsPerStripe(size_.width_px);
  return waiting / stripe_rows * stripe_rows;
}

absl::Status BandJoiner::EncodeRows() {
  if (!is_by_rows()) {
    return absl::OkStatus();
  }
  if (png_rows_.has_value() && !is_opaque_) {
    return absl::InternalError("a pixel over an opaque background is translucent");
  }
  const int count = RowsToEncode();
  if (count == 0) {
    return absl::OkStatus();
  }
  const std::size_t pixel_count = Times(size_.width_px, count);
  const auto rows = std::span<const image::Rgba8>(pixels_).first(pixel_count);
  if (jpeg_rows_.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::string bytes, jpeg_rows_->Append(rows));
    encoded_rows_.push_back(std::move(bytes));
  } else {
    encoded_rows_.push_back(png_rows_->Append(rows));
  }
  pixels_.erase(pixels_.begin(), pixels_.begin() + static_cast<std::ptrdiff_t>(pixel_count));
  begin_row_ += count;
  return absl::OkStatus();
}

// Frees what it has joined, so that the bytes are there once.
std::string BandJoiner::TakeEncodedRows() {
  std::size_t size = 0;
  for (const std::string& rows : encoded_rows_) {
    size += rows.size();
  }
  std::string all;
  all.reserve(size);
  while (!encoded_rows_.empty()) {
    absl::StrAppend(&all, encoded_rows_.front());
    encoded_rows_.pop_front();
  }
  return all;
}

absl::StatusOr<std::string> BandJoiner::EncodePart(const view::Region& part) const {
  ISOSCOPE_CHECK_EQ(pixels_.size(), Times(size_.width_px, size_.height_px));
  return base::OrNoMemory("the bytes of a tile", [&]() -> absl::StatusOr<std::string> {
    std::vector<image::Rgba8> pixels;
    pixels.reserve(Times(part.width_px, part.height_px));
    for (int y = part.y; y < part.y + part.height_px; ++y) {
      const auto row =
          pixels_.begin() + static_cast<std::ptrdiff_t>(Times(size_.width_px, y)) + part.x;
      pixels.insert(pixels.end(), row, row + part.width_px);
    }
    return image::EncodePng(part.width_px, part.height_px, pixels, spec_.background_color);
  });
}

absl::StatusOr<FrameOutput> BandJoiner::Finish() {
  const frame::OutputSpec& wanted = spec_.output;
  if (is_by_rows()) {
    ISOSCOPE_RETURN_IF_ERROR(EncodeRows());
    ISOSCOPE_CHECK_EQ(begin_row_, size_.height_px);
    pixels_ = {};
    if (png_rows_.has_value()) {
      encoded_rows_.push_back(png_rows_->End());
    }
    output_.image = TakeEncodedRows();
  } else if (!pixels_.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        output_.image,
        base::OrNoMemory("the bytes of the picture", [&]() -> absl::StatusOr<std::string> {
          if (wanted.image_format == frame::ImageFormat::kJpeg) {
            return image::EncodeJpeg(size_.width_px, size_.height_px, pixels_,
                                     spec_.background_color, wanted.jpeg_quality);
          }
          return image::EncodePng(size_.width_px, size_.height_px, pixels_, spec_.background_color);
        }));
    pixels_ = {};
  }
  return std::move(output_);
}

}  // namespace isoscope::server
