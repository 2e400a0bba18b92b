#include "wire/response_splitter.h"

#include <string>
#include <vector>

#include "google/protobuf/descriptor.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"

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

}  // namespace
}  // namespace isoscope::wire
