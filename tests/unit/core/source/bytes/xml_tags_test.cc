#include "core/source/bytes/xml_tags.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class XmlTagsTest : public ::testing::Test {
 protected:
  absl::Status Read(const std::string& text) {
    WriteFile(dir_.Sub("f.xml"), text);
    tags_.clear();
    return ReadXmlTags(dir_.Sub("f.xml"), "list", [&](const XmlTag& tag) {
      tags_.push_back(absl::StrCat(tag.parent, ">", tag.name, " a=", tag.Get("a")));
      return tag.name == "bad" ? absl::NotFoundError("no such thing") : absl::OkStatus();
    });
  }
  TempDir dir_;
  std::vector<std::string> tags_;
};

TEST_F(XmlTagsTest, TagsComeWithParentAndAttributes) {
  ISOSCOPE_ASSERT_OK(Read("<?xml version=\"1.0\"?>\n<l a=\"&lt;1\">text<i b='2'/><i a=''/></l>"));
  EXPECT_THAT(tags_, ElementsAre(">l a=<1", "l>i a=", "l>i a="));
}

TEST_F(XmlTagsTest, ErrorsNameFileAndLine) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(Read("<l>\n<bad/>\n<i/></l>"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("f.xml: line 2: no such thing")));
  EXPECT_EQ(tags_.size(), 2u);
  for (const char* text : {"", "<l>", "<l></i>", "no XML", "<l/><l/>"}) {
    EXPECT_THAT(Read(text), StatusIs(kInvalid, AllOf(HasSubstr("f.xml: line"),
                                                     HasSubstr("no list, or it is cut"))))
        << text;
  }
  EXPECT_THAT(Read("<l a=\"" + std::string(3 << 20, 'x')),
              StatusIs(kInvalid, HasSubstr("more than a MiB")));
  std::string deep;
  for (int i = 0; i < 100; ++i) {
    deep += "<l>";
  }
  EXPECT_THAT(Read(deep), StatusIs(kInvalid, HasSubstr("too deep")));
  EXPECT_THAT(ReadXmlTags(dir_.Sub("none"), "list", nullptr),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none")));
}

}  // namespace
}  // namespace isoscope::source
