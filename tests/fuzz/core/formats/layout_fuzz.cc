// NIfTI-2 (one file, a stream, a pair), Analyze, MGH, AFNI, PAR/REC and ParaVision. The first
// byte chooses.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/medical_files.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {
namespace {

enum Kind : std::uint8_t {
  kNifti2,
  kNifti2Stream,
  kNifti2Pair,
  kUnnamed,
  kAnalyze,
  kMgh,
  kMgz,
  kAfni,
  kParRec,
  kBruker,
  kKinds
};

std::string Seed(Kind kind, const std::string& bytes) {
  return std::string(1, static_cast<char>(kind)) + bytes;
}

}  // namespace

std::vector<std::string> Seeds() {
  using testing::AfniBytes;
  using testing::AfniNumbers;
  using testing::AfniText;
  using testing::ParBytes;
  using testing::ParImage;
  const std::string samples(480, 'a');
  const std::string images = ParImage({.slice = 1}) + ParImage({.slice = 2, .index = 1});
  std::vector<std::string> seeds = {
      Seed(kNifti2, testing::Nifti2Bytes({}) + samples),
      Seed(kNifti2,
           testing::Nifti2Bytes({.steps = 2, .components = 3, .is_big_endian = true}) + samples),
      Seed(kNifti2,
           testing::Nifti2Bytes({.datatype = 64, .slope = 2, .qform_code = 1, .sform_code = 0}) +
               samples),
      Seed(kNifti2Stream, testing::Gzip(testing::Nifti2Bytes({}) + samples)),
      Seed(kNifti2Pair, testing::Nifti2Bytes({.is_pair = true})),
      Seed(kUnnamed, testing::NiftiHeaderBytes({.dims = {4, 3, 2}}) + samples),
      Seed(kAnalyze, testing::AnalyzeBytes({.steps = 2, .factor = 0.5F})),
      Seed(kMgh, testing::MghBytes({.frames = 2}) + samples),
      Seed(kMgz, testing::Gzip(testing::MghBytes({.type = 3}) + samples)),
      Seed(kBruker, testing::BrukerText({})),
      Seed(kBruker, testing::BrukerText({.groups = {{2, "FG_ISA"}, {3, "FG_SLICE"}},
                                         .slopes = {1, 2, 3, 4, 5, 6}})),
      Seed(kBruker, testing::BrukerText({.is_volume = true, .groups = {{2, "FG_ECHO"}}})),
      Seed(kAfni, AfniBytes(1, "1", "0.5")),
      Seed(kAfni, AfniBytes(3, "1 1 1", "0 0 1", AfniText("BRICK_LABS", "a~b~a"))),
      Seed(kAfni, AfniBytes(2, "0 0", "0 0",
                            AfniNumbers("TAXIS_NUMS", "2 0 77002", 3) +
                                AfniNumbers("TAXIS_FLOATS", "0 2.5", 2))),
      Seed(kParRec, ParBytes(images, "10 20 30")),
      Seed(kParRec, ParBytes(images + ParImage({.slice = 1, .echo = 2, .index = 2}) +
                             ParImage({.slice = 2, .echo = 2, .index = 3, .slope = 2})))};
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const std::uint8_t kind = input.Byte() % kKinds;
  constexpr const char* kNames[] = {"v.nii", "v.nii.gz", "w.hdr",  "unnamed", "w.hdr",
                                    "v.mgh", "v.mgz",    "v.HEAD", "v.PAR",   "visu_pars"};
  WriteVolumeFile(kNames[kind], input.Rest());
  for (const char* samples : {"w.img", "v.BRIK", "v.REC", "2dseq"}) {
    WriteVolumeFile(samples, std::string(600, 'c'));
  }
  OpenAndReadSeries(InVolumeFolder(kNames[kind]));
  return 0;
}
