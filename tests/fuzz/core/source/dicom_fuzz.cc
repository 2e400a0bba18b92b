// A DICOM series of two slices, one of them hostile. The first byte chooses whether the other one
// is there.
//
// Our own look through the file is fuzzed in full. GDCM, as Debian builds it, ends the process by
// assertions on many broken files: behind our look, the series is opened in a process of its own,
// where GDCM's assertions are let pass, and nothing else is (docs/fuzzing.md).

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include <sys/wait.h>

#include "core/source/dicom_scan.h"
#include "tests/fuzz/core/source/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/dicom_file.h"

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

// What the process wrote to its standard error, until its end.
std::string ReadToEnd(int pipe_end) {
  std::string text;
  std::array<char, 4096> part{};
  ssize_t size = 0;
  while ((size = read(pipe_end, part.data(), part.size())) > 0 || (size < 0 && errno == EINTR)) {
    text.append(part.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  }
  close(pipe_end);
  return text;
}

void OpenInProcess() {
  std::array<int, 2> ends{};
  Require(pipe(ends.data()) == 0, "there is a pipe");
  const pid_t child = fork();
  Require(child >= 0, "there is a process");
  if (child == 0) {
    std::signal(SIGABRT, SIG_DFL);  // its input is kept by the parent
    dup2(ends[1], STDERR_FILENO);
    close(ends[0]);
    close(ends[1]);
    OpenAndReadVolume(VolumeFolder());
    _exit(0);
  }
  close(ends[1]);
  const std::string text = ReadToEnd(ends[0]);
  int status = 0;
  Require(waitpid(child, &status, 0) == child, "the process ends");
  const bool is_assertion_of_gdcm = WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT &&
                                    absl::StrContains(text, "gdcm") &&
                                    absl::StrContains(text, "Assertion `");
  if (status != 0 && !is_assertion_of_gdcm) {
    std::cerr << text;
    Require(false, "a series is opened or refused");
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  testing::DicomSlice open;
  open.width = 4;
  open.height = 3;
  open.is_signed = false;
  open.more = testing::DicomOpenElement(
      0x29, 0x1010, "SQ", testing::DicomOpenItem(testing::DicomElement(0x29, 0x1011, "LO", "x")));
  return {std::string(1, '\0') + Slice(1), "\1" + Slice(1),
          "\1" + testing::DicomBytes(open, std::string(24, 'b'))};
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
  const auto scan = isoscope::source::ScanDicomFile(InVolumeFolder("1.dcm"));
  Require(scan.ok(), "any bytes can be looked through");
  if (scan->content == isoscope::source::DicomContent::kImage) {
    OpenInProcess();
  } else {
    OpenAndReadVolume(VolumeFolder());
  }
  return 0;
}
