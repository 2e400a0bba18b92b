#include "wire/response_splitter.h"

#include <algorithm>
#include <utility>

#include "core/base/memory_info.h"
#include "core/frame/output_spec.h"

namespace isoscope::wire {
namespace {

using isoscope::v1::RenderIsosurfaceResponse;

// Every `bytes` field of the response; the test compares this with its descriptor.
struct BytesField {
  const std::string& (*get)(const RenderIsosurfaceResponse& response);
  std::string* (*mutable_bytes)(RenderIsosurfaceResponse* response);
};

template <auto kGet, auto kMutable>
constexpr BytesField FieldOf() {
  return {[](const RenderIsosurfaceResponse& response) -> const std::string& {
            return (response.*kGet)();
          },
          [](RenderIsosurfaceResponse* response) { return (response->*kMutable)(); }};
}

constexpr BytesField kBytesFields[] = {
    FieldOf<&RenderIsosurfaceResponse::png, &RenderIsosurfaceResponse::mutable_png>(),
    FieldOf<&RenderIsosurfaceResponse::jpeg, &RenderIsosurfaceResponse::mutable_jpeg>(),
    FieldOf<&RenderIsosurfaceResponse::rgba8, &RenderIsosurfaceResponse::mutable_rgba8>(),
    FieldOf<&RenderIsosurfaceResponse::depth, &RenderIsosurfaceResponse::mutable_depth>(),
    FieldOf<&RenderIsosurfaceResponse::surface_index,
            &RenderIsosurfaceResponse::mutable_surface_index>(),
    FieldOf<&RenderIsosurfaceResponse::position, &RenderIsosurfaceResponse::mutable_position>(),
    FieldOf<&RenderIsosurfaceResponse::normal, &RenderIsosurfaceResponse::mutable_normal>(),
    FieldOf<&RenderIsosurfaceResponse::depth_bounds,
            &RenderIsosurfaceResponse::mutable_depth_bounds>(),
};

}  // namespace

ResponseSplitter::ResponseSplitter(RenderIsosurfaceResponse response) {
  for (const BytesField& field : kBytesFields) {
    std::string bytes = std::exchange(*field.mutable_bytes(&response), std::string());
    planes_.push_back(std::move(bytes));
  }
  first_ = std::move(response);
}

bool ResponseSplitter::Next(RenderIsosurfaceResponse* part) {
  part->Clear();
  if (!is_first_sent_) {
    is_first_sent_ = true;
    part->Swap(&first_);
    return true;
  }
  while (plane_ < planes_.size() && offset_ == planes_[plane_].size()) {
    std::string().swap(planes_[plane_]);  // frees it
    ++plane_;
    offset_ = 0;
  }
  if (plane_ == planes_.size()) {
    return false;
  }
  std::string& plane = planes_[plane_];
  const std::size_t size = std::min(kMaxPartBytes, plane.size() - offset_);
  kBytesFields[plane_].mutable_bytes(part)->assign(plane, offset_, size);
  base::ReturnPages(plane.data() + offset_, size);
  offset_ += size;
  return true;
}

void ReserveRaw(const isoscope::v1::OutputOptions& output, std::size_t max_bytes,
                RenderIsosurfaceResponse* response) {
  using isoscope::v1::OutputOptions;
  const auto pixels = static_cast<std::size_t>(std::max(response->extent().width_px(), 0)) *
                      static_cast<std::size_t>(std::max(response->extent().height_px(), 0));
  const std::pair<std::string* (RenderIsosurfaceResponse::*)(), std::size_t> pixel_bytes[] = {
      {&RenderIsosurfaceResponse::mutable_rgba8,
       output.image_format() == OutputOptions::IMAGE_FORMAT_RGBA8 ? frame::kRgba8Bytes : 0},
      {&RenderIsosurfaceResponse::mutable_depth, output.depth() ? frame::kDepthBytes : 0},
      {&RenderIsosurfaceResponse::mutable_surface_index,
       output.surface_index() ? frame::kSurfaceIndexBytes : 0},
      {&RenderIsosurfaceResponse::mutable_position, output.position() ? frame::kPositionBytes : 0},
      {&RenderIsosurfaceResponse::mutable_normal, output.normal() ? frame::kNormalBytes : 0},
  };
  std::size_t sum = 0;
  for (const auto& [field, bytes] : pixel_bytes) {
    sum += bytes;
  }
  if (sum == 0 || pixels > max_bytes / sum) {
    return;
  }
  for (const auto& [field, bytes] : pixel_bytes) {
    if (bytes > 0) {
      (response->*field)()->reserve(pixels * bytes);
    }
  }
}

void AppendPart(RenderIsosurfaceResponse part, RenderIsosurfaceResponse* response) {
  for (const BytesField& field : kBytesFields) {
    const std::string& piece = field.get(part);
    if (!piece.empty()) {
      field.mutable_bytes(response)->append(piece);
      field.mutable_bytes(&part)->clear();
    }
  }
  response->MergeFrom(part);
}

}  // namespace isoscope::wire
