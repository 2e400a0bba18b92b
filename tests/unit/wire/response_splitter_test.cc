#include "wire/response_splitter.h"

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "google/protobuf/descriptor.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"

#include "core/base/memory_info.h"

namespace isoscope::wire {
namespace {

using google::protobuf::FieldDescriptor;
using isoscope::v1::RenderIsosurfaceResponse;

// Every `bytes` field set to bytes of its own, of different sizes.
RenderIsosurfaceResponse MakeResponse() {
  RenderIsosurfaceResponse response;
  response.mutable_extent()->set_width_px(7);
  response.mutable_statistics()->set_triangle_count(12);
  response.mutable_camera()->mutable_eye()->set_x(1.5);
  const auto* descriptor = RenderIsosurfaceResponse::descriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const FieldDescriptor* field = descriptor->field(i);
    if (field->type() != FieldDescriptor::TYPE_BYTES) {
      continue;
    }
    std::string bytes(kMaxPartBytes * static_cast<std::size_t>(field->number() % 3) +
                          static_cast<std::size_t>(field->number()),
                      static_cast<char>('a' + field->number()));
    bytes.back() = 'z';
    response.GetReflection()->SetString(&response, field, bytes);
  }
  return response;
}

TEST(ResponseSplitterTest, PartsAreSmallAndMakeTheWholeAgain) {
  const RenderIsosurfaceResponse whole = MakeResponse();
  ResponseSplitter splitter(whole);
  RenderIsosurfaceResponse part;
  RenderIsosurfaceResponse together;
  int count = 0;
  while (splitter.Next(&part)) {
    EXPECT_LE(part.ByteSizeLong(), kMaxPartBytes + 1024) << "part " << count;
    EXPECT_EQ(part.has_statistics(), count == 0);
    AppendPart(part, &together);
    ++count;
  }
  EXPECT_GT(count, 8);
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(whole, together));
  EXPECT_FALSE(splitter.Next(&part)) << "after the end";
}

TEST(ResponseSplitterTest, AResponseWithoutBytesIsOnePart) {
  RenderIsosurfaceResponse small;
  small.mutable_extent()->set_width_px(3);
  ResponseSplitter splitter(small);
  RenderIsosurfaceResponse part;
  ASSERT_TRUE(splitter.Next(&part));
  EXPECT_EQ(part.extent().width_px(), 3);
  EXPECT_FALSE(splitter.Next(&part));
}

// Symptom: a plane of 8K was in the coordinator until its last part was sent, and in the gateway.
TEST(ResponseSplitterTest, BytesThatAreCutOffAreFree) {
  constexpr std::size_t kBytes = 64 * kMaxPartBytes;
  RenderIsosurfaceResponse whole;
  whole.set_depth(std::string(kBytes, 'd'));
  ResponseSplitter splitter(std::move(whole));
  const std::string expected(kMaxPartBytes, 'd');
  const std::size_t before = base::ResidentBytes();
  RenderIsosurfaceResponse part;
  ASSERT_TRUE(splitter.Next(&part));
  for (int i = 0; i < 48; ++i) {
    ASSERT_TRUE(splitter.Next(&part));
    ASSERT_TRUE(part.depth() == expected) << i;
  }
  EXPECT_LT(base::ResidentBytes() + kBytes / 2, before);
}

TEST(ReserveRawTest, PlanesDoNotMoveAsTheyGrow) {
  isoscope::v1::OutputOptions output;
  output.set_image_format(isoscope::v1::OutputOptions::IMAGE_FORMAT_NONE);
  output.set_depth(true);
  output.set_surface_index(true);
  RenderIsosurfaceResponse response;
  response.mutable_extent()->set_width_px(1000);
  response.mutable_extent()->set_height_px(300);
  ReserveRaw(output, std::size_t{300'000} * 5, &response);
  EXPECT_GE(response.depth().capacity(), std::size_t{300'000} * 4);
  EXPECT_GE(response.surface_index().capacity(), std::size_t{300'000});
  EXPECT_LT(response.position().capacity(), std::size_t{1000});
  const char* const begin = response.depth().data();
  RenderIsosurfaceResponse part;
  part.set_depth(std::string(1000, 'd'));
  for (int i = 0; i < 1200; ++i) {
    AppendPart(part, &response);
  }
  EXPECT_EQ(response.depth().data(), begin);
}

TEST(ReserveRawTest, AnExtentBeyondTheBoundOrOfNoSenseTakesNothing) {
  isoscope::v1::OutputOptions output;
  output.set_image_format(isoscope::v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  output.set_normal(true);
  for (const auto& [width, height] : {std::pair(2147483647, 2147483647), {-5, 7}, {1001, 1}}) {
    RenderIsosurfaceResponse response;
    response.mutable_extent()->set_width_px(width);
    response.mutable_extent()->set_height_px(height);
    ReserveRaw(output, /*max_bytes=*/16'000, &response);
    EXPECT_LT(response.rgba8().capacity(), std::size_t{100});
    EXPECT_LT(response.normal().capacity(), std::size_t{100});
  }
}

}  // namespace
}  // namespace isoscope::wire
