// docs/formats.md has a table for people. It names the files that the opener takes, no more and no
// fewer.

#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/find_volume.h"

namespace isoscope::source {
namespace {

std::string ReadDocument() {
  std::ifstream in(ISOSCOPE_FORMATS_DOCUMENT);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// The endings in a text, in lower case: ".nii" of "`.nii` `.hdr`" and of "file.nii, .hdr".
std::set<std::string> EndingsIn(const std::string& text) {
  static const std::regex* const ending = new std::regex(R"(\.[a-z][a-z0-9]*(\.(gz|bz2))?)");
  const std::string lower = absl::AsciiStrToLower(text);
  std::set<std::string> endings;
  for (auto found = std::sregex_iterator(lower.begin(), lower.end(), *ending);
       found != std::sregex_iterator(); ++found) {
    endings.insert(found->str());
  }
  return endings;
}

// The endings of the rows of the document.
std::set<std::string> DocumentedEndings() {
  std::set<std::string> endings;
  for (const std::string& line : std::vector<std::string>(absl::StrSplit(ReadDocument(), '\n'))) {
    const std::vector<std::string> cells = absl::StrSplit(line, '|');
    if (cells.size() != 7) {
      continue;
    }
    // The cell may link to a heading of the page.
    const std::set<std::string> named = EndingsIn(cells[2].substr(0, cells[2].find("([below]")));
    for (const std::string& ending : named) {
      endings.insert(ending);
      if (absl::StrContains(cells[2], "each also `.gz`")) {
        endings.insert(absl::StrCat(absl::StripSuffix(ending, ".gz"), ".gz"));
      }
    }
  }
  endings.erase(".gz");
  return endings;
}

TEST(FormatDocumentsTest, TheTableNamesAllFilesOfEachFormat) {
  const std::set<std::string> documented = DocumentedEndings();
  ASSERT_GT(documented.size(), 40U) << "docs/formats.md has no such table";
  for (const FormatName& format : FormatNames()) {
    for (const std::string& ending : EndingsIn(format.files)) {
      EXPECT_TRUE(documented.contains(ending)) << format.name << ": " << ending;
    }
  }
}

TEST(FormatDocumentsTest, FilesOfTheTableAreTakenByTheirNames) {
  // Samples beside a header of another ending.
  const std::set<std::string> only_beside_others{".rec"};
  for (const std::string& ending : DocumentedEndings()) {
    EXPECT_TRUE(NamesFormat("none*" + ending) || only_beside_others.contains(ending)) << ending;
  }
}

}  // namespace
}  // namespace isoscope::source
