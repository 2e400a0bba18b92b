// Lists that servers send: keys of S3 and pages of an index. What is taken leads below the folder.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"

#include "core/source/bytes/object_key.h"
#include "core/source/remote/list_objects.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

void Run(absl::string_view text) {
  const auto page = source::ParseS3List(text);
  if (!page.ok()) {
    RequireError(page.status(), {absl::StatusCode::kInvalidArgument}, "list");
  } else {
    for (const source::ListedObject& object : page->objects) {
      Require(object.size >= -1, "a size is a number of bytes");
      Require(object.key.size() <= text.size(), "a key is no longer than the list");
    }
  }
  for (const std::string& name : source::NamesOfIndex(text, "/data/")) {
    const std::string plain(absl::StripSuffix(name, "/"));
    Require(source::CheckObjectKey(plain).ok() && !absl::StrContains(plain, "/"),
            "a link leads one level below its page");
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  return {
      "<?xml "
      "version=\"1.0\"?><ListBucketResult><EncodingType>url</EncodingType><IsTruncated>true</"
      "IsTruncated>"
      "<NextContinuationToken>t</NextContinuationToken><Contents><Key>a%20b+c</Key><Size>12</Size>"
      "</Contents></ListBucketResult>",
      "<html><a href=\"../\">up</a><a href=\"a%20b\">a</a><a href='/data/c&amp;d/'>c</a></html>"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run({reinterpret_cast<const char*>(data), size});
  return 0;
}
