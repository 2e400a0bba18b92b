#include "wire/response_splitter.h"

#include <algorithm>
#include <utility>

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
  const std::size_t size = std::min(kMaxPartBytes, planes_[plane_].size() - offset_);
  kBytesFields[plane_].mutable_bytes(part)->assign(planes_[plane_], offset_, size);
  offset_ += size;
  return true;
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
