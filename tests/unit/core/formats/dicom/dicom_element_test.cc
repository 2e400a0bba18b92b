#include "core/formats/dicom/dicom_element.h"

#include <cstdint>
#include <memory>
#include <string>

#include "gtest/gtest.h"

#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomNumber;

class DicomElementTest : public ::testing::Test {
 protected:
  const io::RandomAccessFile& Open(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("f"), bytes);
    file_ = io::OpenRandomAccessFile(dir_.Sub("f")).value();
    return *file_;
  }
  DicomStart StartOf(const std::string& bytes) {
    return FindDicomStart(Open(bytes), &is_explicit_).value();
  }

  testing::TempDir dir_;
  std::unique_ptr<io::RandomAccessFile> file_;
  bool is_explicit_ = false;
};

// In the implicit encoding: tag, then a length of 32 bits.
std::string Implicit(std::uint16_t group, std::uint16_t element, std::string value) {
  value.resize(value.size() + value.size() % 2, '\0');
  return DicomNumber(group) + DicomNumber(element) +
         DicomNumber(static_cast<std::uint32_t>(value.size())) + value;
}

TEST_F(DicomElementTest, HeadsAndUidsAreReadInTheirEncoding) {
  DicomElementReader reader(&Open(testing::DicomElement(8, 0x16, "UI", "1.2.3") +
                                  testing::DicomElement(0x7fe0, 0x10, "OW", "abcd") +
                                  testing::DicomElement(9, 1, "UN", "")));
  DicomElement element;
  EXPECT_TRUE(reader.ReadHead(&element).value());
  EXPECT_EQ(element.tag, 0x00080016U);
  EXPECT_EQ(element.length, 6U);
  EXPECT_TRUE(element.has_kind);
  EXPECT_TRUE(element.is_no_short);
  EXPECT_EQ(reader.ReadUid(element.length).value(), "1.2.3");
  reader.Skip(element.length);
  EXPECT_TRUE(reader.ReadHead(&element).value());
  EXPECT_EQ(element.length, 4U) << "of 32 bits, behind two that are not used";
  reader.Skip(element.length);
  EXPECT_TRUE(reader.ReadHead(&element).value());
  EXPECT_TRUE(element.is_unknown);
  EXPECT_FALSE(reader.Has(1));
  EXPECT_FALSE(reader.ReadHead(&element).value());

  DicomElementReader implicit(&Open(Implicit(0x28, 0x10, "ab")));
  implicit.set_is_explicit(false);
  EXPECT_TRUE(implicit.ReadHead(&element).value());
  EXPECT_EQ(element.tag, 0x00280010U);
  EXPECT_EQ(element.length, 2U);
  EXPECT_FALSE(element.has_kind);
}

TEST_F(DicomElementTest, FilesBeginWithAMarkOrWithElementsOfDicom) {
  const std::string object_class = "1.2.840.10008.5.1.4.1.1.4";
  EXPECT_EQ(StartOf(std::string(128, 'x') + "DICM"), DicomStart::kMark);
  EXPECT_EQ(StartOf(testing::DicomElement(2, 0x10, "UI", "1.2.840.10008.1.2")), DicomStart::kMeta);
  EXPECT_EQ(StartOf(testing::DicomElement(8, 5, "CS", "A") +
                    testing::DicomElement(8, 0x16, "UI", object_class)),
            DicomStart::kDataSet);
  EXPECT_TRUE(is_explicit_);
  EXPECT_EQ(StartOf(Implicit(8, 5, "A") + Implicit(8, 0x16, object_class)), DicomStart::kDataSet);
  EXPECT_FALSE(is_explicit_);
}

TEST_F(DicomElementTest, OtherFilesAreNotTakenForDicom) {
  const std::string data = Implicit(8, 0x16, "1.2.840.10008.5.1.4.1.1.4");
  for (const std::string& bytes :
       {std::string(), std::string("\x08\0", 2), std::string(1000, '\x08'), std::string(1000, '\0'),
        std::string(128, 'x') + "DICN", std::string("\x08\0\x05\0\0\0\0\0", 8),  // no class
        Implicit(8, 0x16, "1.2.3.4"),                                            // not DICOM's
        Implicit(8, 0x18, "1.2.3") + data,                                       // behind it
        Implicit(8, 8, "A") + Implicit(8, 5, "B") + data,                        // out of order
        Implicit(8, 5, "A").substr(0, 6) + data, Implicit(6, 0, "A") + data,
        testing::DicomElement(8, 5, "CS", "A") + data,  // no kind
        testing::DicomElement(8, 5, "CS", "A") +
            testing::DicomElement(8, 0x16, "ZZ", "1.2.840.10008.5.1.4.1.1.4"),
        testing::DicomElement(2, 0x10, "UI", "1.2.3"), Implicit(2, 0x10, "1.2.840.10008.1.2"),
        std::string("II*\0\x08\0\0\0", 8) + data}) {
    EXPECT_EQ(StartOf(bytes), DicomStart::kNone) << bytes.size();
  }
}

}  // namespace
}  // namespace isoscope::source
