#include "core/rpc/response_splitter.h"

#include <algorithm>
#include <utility>

namespace isoscope::rpc {
namespace {

using isoscope::v1::RenderIsosurfaceResponse;

// Every `bytes` field of the response; the test compares this with its descriptor.
struct BytesField {
  const std::string& (RenderIsosurfaceResponse::*get)() const;
  std::string* (RenderIsosurfaceResponse::*mutable_bytes)();
};
constexpr BytesField kBytesFields[] = {
    {&RenderIsosurfaceResponse::png, &RenderIsosurfaceResponse::mutable_png},
    {&RenderIsosurfaceResponse::jpeg, &RenderIsosurfaceResponse::mutable_jpeg},
    {&RenderIsosurfaceResponse::rgba8, &RenderIsosurfaceResponse::mutable_rgba8},
    {&RenderIsosurfaceResponse::depth, &RenderIsosurfaceResponse::mutable_depth},
    {&RenderIsosurfaceResponse::surface_index, &RenderIsosurfaceResponse::mutable_surface_index},
    {&RenderIsosurfaceResponse::position, &RenderIsosurfaceResponse::mutable_position},
    {&RenderIsosurfaceResponse::normal, &RenderIsosurfaceResponse::mutable_normal},
};

}  // namespace

ResponseSplitter::ResponseSplitter(RenderIsosurfaceResponse response) {
  for (const BytesField& field : kBytesFields) {
    std::string bytes = std::exchange(*(response.*field.mutable_bytes)(), std::string());
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
  *(part->*kBytesFields[plane_].mutable_bytes)() = planes_[plane_].substr(offset_, size);
  offset_ += size;
  return true;
}

void AppendPart(RenderIsosurfaceResponse part, RenderIsosurfaceResponse* response) {
  for (const BytesField& field : kBytesFields) {
    const std::string& piece = (part.*field.get)();
    if (!piece.empty()) {
      (response->*field.mutable_bytes)()->append(piece);
      (part.*field.mutable_bytes)()->clear();
    }
  }
  response->MergeFrom(part);
}

}  // namespace isoscope::rpc
