// A DICOM series of two slices, one of them hostile. The first byte chooses whether the other one
// is there.
//
// Our own look through the file is fuzzed in full. GDCM, as Debian builds it, ends the process it
// runs in by assertions on many broken files, which is not this one (docs/lab/fuzzing.md).

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "core/formats/dicom/dicom_scan.h"
#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/dicom_file.h"
#include "tests/unit/core/formats/dicom/htj2k_bytes.h"
#include "tests/unit/core/formats/dicom/segmentation_bytes.h"

namespace isoscope::fuzz {
namespace {

std::string Slice(int number) {
  testing::DicomSlice slice;
  slice.width = 4;
  slice.height = 3;
  slice.number = number;
  slice.position = number == 1 ? "10\\20\\30" : "10\\20\\31";
  return testing::DicomBytes(slice, std::string(24, 'a'));
}

// Two segments that overlap, and a plane that is left out.
std::string Segmentation(const std::string& kind, std::uint16_t bits) {
  const std::vector<int> pixels(15, 1);
  std::vector<testing::SegmentFrame> frames{{"0\\0\\1", 1, pixels}, {"0\\0\\3", 1, pixels}};
  if (kind == "BINARY") {
    frames.push_back({"0\\0\\3", 2, pixels});
  }
  return testing::SegmentationBytes({.kind = kind,
                                     .bits = bits,
                                     .frames = frames,
                                     .segments = {{1, "one", {{0, 1, 2}}}},
                                     .distance = "1"});
}

// Returns the children of this thread, including those that were not waited for. libFuzzer has one,
// too: its symbolizer.
std::string Children() {
  std::ifstream list("/proc/thread-self/children");
  return {std::istreambuf_iterator<char>(list), {}};
}

}  // namespace

std::vector<std::string> Seeds() {
  testing::DicomSlice open;
  open.width = 4;
  open.height = 3;
  open.is_signed = false;
  open.more = testing::DicomOpenElement(
      0x29, 0x1010, "SQ", testing::DicomOpenItem(testing::DicomElement(0x29, 0x1011, "LO", "x")));
  // Two frames with positions of their own.
  using testing::DicomElement;
  using testing::DicomItem;
  testing::DicomSlice framed;
  framed.width = 4;
  framed.height = 3;
  framed.frames = 2;
  framed.description = "frames";
  std::string groups;
  for (const char* position : {"10\\20\\30", "10\\20\\31"}) {
    groups += DicomItem(
        DicomElement(0x20, 0x9113, "SQ", DicomItem(DicomElement(0x20, 0x32, "DS", position))));
  }
  framed.more = DicomElement(0x5200, 0x9230, "SQ", groups);
  testing::DicomSlice second;  // at the same place: a step
  second.width = 4;
  second.height = 3;
  second.position = "10\\20\\31";
  second.temporal_position = 2;
  testing::DicomSlice nuclear;  // two slices against the normal
  nuclear.width = 4;
  nuclear.height = 3;
  nuclear.frames = 2;
  nuclear.storage_class = "1.2.840.10008.5.1.4.1.1.20";
  nuclear.more =
      DicomElement(0x18, 0x88, "DS", "-3") +
      DicomElement(0x54, 0x22, "SQ", DicomItem(DicomElement(0x20, 0x32, "DS", "1\\2\\3"))) +
      DicomElement(0x54, 0x80, "US", std::string("\1\0\2\0", 4));
  testing::DicomSlice compressed;
  compressed.width = 4;
  compressed.height = 3;
  compressed.slope = "0.5";
  compressed.intercept = "-1";
  compressed.transfer_syntax = testing::kDicomRle;
  testing::DicomSlice high_throughput;
  high_throughput.width = 8;
  high_throughput.height = 8;
  high_throughput.transfer_syntax = "1.2.840.10008.1.2.4.201";
  high_throughput.fragments = {testing::Htj2kBytes()};
  return {std::string(1, '\0') + Slice(1),
          "\1" + Slice(1).substr(132),  // without a mark
          std::string(1, '\0') + testing::DicomBytes(nuclear, std::string(48, 'e')),
          "\1" + testing::DicomBytes(compressed, std::string(24, 'f')),
          std::string(1, '\0') + testing::DicomBytes(high_throughput, ""),
          "\1" + Slice(1),
          "\1" + testing::DicomBytes(open, std::string(24, 'b')),
          std::string(1, '\0') + testing::DicomBytes(framed, std::string(48, 'c')),
          "\1" + testing::DicomBytes(second, std::string(24, 'd')),
          std::string(1, '\0') + Segmentation("BINARY", 1),
          std::string(1, '\0') + Segmentation("LABELMAP", 16)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const bool has_other = input.Byte() % 2 == 1;
  WriteVolumeFile("1.dcm", input.Rest());
  if (has_other) {
    WriteVolumeFile("2.dcm", Slice(2));
  } else {
    std::filesystem::remove(InVolumeFolder("2.dcm"));
  }
  Require(isoscope::source::ScanDicomFile(InVolumeFolder("1.dcm")).ok(),
          "any bytes can be looked through");
  const std::string before = Children();
  OpenAndReadSeries(VolumeFolder());
  Require(Children() == before, "the processes that decode end with their source");
  return 0;
}
