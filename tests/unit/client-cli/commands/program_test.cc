#include "client-cli/commands/program.h"

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/units.h"
#include "core/base/version.h"
#include "core/cli/interrupt.h"
#include "core/io/file.h"
#include "core/math/vec.h"
#include "core/store/shard_reader.h"
#include "core/volume/scalar_type.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Outcome {
  int exit_code = 0;
  std::string out;
  std::string err;
};

Outcome RunCli(const std::vector<std::string>& arguments) {
  Interrupt interrupt;
  std::ostringstream out;
  std::ostringstream err;
  const int exit_code =
      RunProgram(IsoscopeProgram(), arguments, {.out = &out, .err = &err, .interrupt = &interrupt});
  return {exit_code, out.str(), err.str()};
}

// A wrong command line, and what its one line of standard error must say.
struct WrongUsage {
  std::vector<std::string> arguments;
  std::vector<std::string> said;
};

std::ostream& operator<<(std::ostream& out, const WrongUsage& row) {
  for (const std::string& argument : row.arguments) {
    out << argument << " ";
  }
  return out;
}

class WrongUsageTest : public ::testing::TestWithParam<WrongUsage> {};

TEST_P(WrongUsageTest, ExitsWithTwoAndOneLineThatHelps) {
  const Outcome outcome = RunCli(GetParam().arguments);
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_THAT(outcome.err, StartsWith("isoscope"));
  EXPECT_EQ(outcome.err.find('\n'), outcome.err.size() - 1) << outcome.err;
  for (const std::string& text : GetParam().said) {
    EXPECT_THAT(outcome.err, HasSubstr(text));
  }
}

std::vector<WrongUsage> GeneralRows() {
  return {
      {{}, {"a command is missing", "partition, info, verify, serve, render, pick, export"}},
      {{"rendr"}, {"'rendr' is no command", "did you mean 'render'", "partition"}},
      {{"copy"}, {"ADDRESS is missing", "s3://BUCKET/KEY"}},
      {{"bench", "frame", "--runs", "3"}, {"'bench' is no command", "isoscope-bench"}},
      {{"help", "rendr"}, {"'rendr' is no command"}},
      {{"qqqqqqq"}, {"'qqqqqqq' is no command", "There are: partition"}},
      {{"--isovalue", "3"}, {"unknown flag --isovalue", "a command comes first"}},
      {{"info"}, {"give a volume, a dataset folder or --server"}},
      {{"info", "v.nrrd", "--dims", "2,2,2"}, {"--dims is for raw files only", "'v.nrrd'"}},
      {{"info", "--server", "h:1", "--type", "uint8"}, {"--type can't be used with --server"}},
      {{"info", "d", "--server", "h:1"}, {"can't be used with --server"}},
      {{"info", "d", "--jsn"}, {"unknown flag --jsn", "did you mean --json"}},
      {{"info", "d", "e"}, {"'e' is one argument too many"}},
      {{"info", "--server", "h:"}, {"--server", "'h:' is not HOST:PORT"}},
      {{"serve"}, {"INPUT or DIR is missing"}},
      {{"serve", "d", "--listen", "70000"}, {"--listen", "HOST:PORT"}},
      {{"serve", "d", "--renderer", "gl"}, {"--renderer", "\"gl\"", "auto", "egl", "cpu"}},
      {{"serve", "d", "--threads", "0"}, {"--threads", "'0' is not a whole number from 1"}},
  };
}

std::vector<WrongUsage> PartitionRows() {
  return {
      {{"partition"}, {"INPUT is missing"}},
      {{"partition", "v.nrrd"}, {"--output DIR is missing"}},
      {{"partition", "v.nrrd", "--output"}, {"--output"}},
      {{"partition", "v.nrrd", "--output", ""}, {"--output", "is empty"}},
      {{"partition", "v.nrrd", "--output", "d", "--shards", "0"},
       {"--shards", "'0' is not a whole number from 1"}},
      {{"partition", "v.nrrd", "--output", "d", "--shards", "-2"}, {"--shards", "'-2'"}},
      {{"partition", "v.nrrd", "--output", "d", "--shards", "two"}, {"--shards", "'two'"}},
      {{"partition", "v.nrrd", "--output", "d", "--shards", "1", "--shards", "2"}, {"--shards"}},
      {{"partition", "v.nrrd", "--output", "d", "--block-cells", "8x8"},
       {"--block-cells", "N or NXxNYxNZ"}},
      {{"partition", "v.nrrd", "--output", "d", "--distribution", "even"},
       {"--distribution", "\"even\"", "greedy"}},
      {{"partition", "v.nrrd", "--output", "d", "--seed", "-1"}, {"--seed", "'-1'"}},
      {{"partition", "v.nrrd", "--output", "d", "--memory-limit", "1kb"},
       {"--memory-limit", "'1kb'", "MiB"}},
      {{"partition", "v.nrrd", "--output", "d", "--dims", "4,4,4", "--type", "uint8"},
       {"--dims is for raw files only", "'v.nrrd'"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4,4"}, {"--type is missing"}},
      {{"partition", "v.raw", "--output", "d", "--type", "uint8"}, {"--dims is missing"}},
      {{"partition", "v.raw", "--output", "d", "--header-bytes", "16"},
       {"both --dims X,Y,Z and --type"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4", "--type", "uint8"},
       {"--dims", "'4,4' is not X,Y,Z"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4,4", "--type", "byte"},
       {"--type", "\"byte\"", "uint8"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4,4", "--type", "uint8", "--endian",
        "middle"},
       {"--endian", "'middle' is none of: little, big"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4,4", "--type", "uint8", "--spacing",
        "0,1,1"},
       {"--spacing", "above 0"}},
      {{"partition", "v.raw", "--output", "d", "--dims", "4,4,4", "--type", "uint8",
        "--header-bytes", "-1"},
       {"--header-bytes"}},
      {{"partition", "v.nrrd", "--append", "d", "--output", "e"},
       {"--output can't be used with --append DIR"}},
      {{"partition", "v.nrrd", "--append", "d", "--shards", "2"},
       {"--shards can't be used with --append DIR", "cut as the series"}},
      {{"partition", "v.nrrd", "--append", "d", "--block-cells", "8"}, {"--block-cells can't"}},
      {{"partition", "v.nrrd", "--append", "d", "--seed", "8"}, {"--seed can't"}},
      {{"partition", "v.nrrd", "--append", "d", "--distribution", "random"},
       {"--distribution can't"}},
      {{"partition", "v.nrrd", "--output", "d", "--levels", "some"},
       {"--levels", "'some' is neither auto, none nor a whole number from 0 to 23"}},
      {{"partition", "v.nrrd", "--output", "d", "--levels", "24"}, {"--levels", "'24'"}},
      {{"partition", "v.nrrd", "--append", "d", "--levels", "2"},
       {"--levels can't be used with --append DIR", "levels of the series"}},
      {{"partition", "v.nrrd", "--append", "d", "--label-levels"}, {"--label-levels can't"}},
      {{"partition", "v.nrrd", "--add-levels", "d"}, {"INPUT can't", "--add-levels DIR"}},
      {{"partition", "--add-levels", "d", "--output", "e"},
       {"--output can't be used with --add-levels DIR"}},
      {{"partition", "--add-levels", "d", "--append", "e"}, {"--append can't"}},
      {{"partition", "--add-levels", "d", "--step", "1"}, {"--step can't"}},
      {{"partition", "--add-levels", "d", "--dims", "4,4,4"}, {"--dims can't"}},
      {{"partition", "--add-levels", "d", "--drop-levels", "d"}, {"exclude each other"}},
      {{"partition", "--add-levels", "d", "--levels", "none"},
       {"--levels none can't", "--drop-levels"}},
      {{"partition", "--drop-levels", "d", "--levels", "2"},
       {"--levels can't be used with --drop-levels DIR"}},
      {{"partition", "--drop-levels", "d", "--compression", "lz4"}, {"--compression can't"}},
      {{"partition", "--drop-levels", "d", "--compact"},
       {"--compact can't be used with --drop-levels DIR"}},
      {{"partition", "--finish", "d", "--compact"}, {"--compact can't be used with --finish DIR"}},
      {{"partition", "v.nrrd", "--output", "d", "--compact", "--compression", "zstd"},
       {"--compact can't be used with --compression zstd", "--compression packed"}},
      {{"partition", "v.nrrd", "--output", "d", "--compression", "gzip"},
       {"\"gzip\"", "none, lz4, zstd or packed"}},
      {{"partition", "v.nrrd", "--output", "d", "--part", "2/2"},
       {"--part", "'2/2' is no part I/N", "I is from 0 to 1 of 2"}},
      {{"partition", "v.nrrd", "--output", "d", "--part", "3"}, {"'3' is no part I/N", "0/16"}},
      {{"partition", "v.nrrd", "--part", "0/2"}, {"--output DIR is missing"}},
      {{"partition", "v.nrrd", "--append", "d", "--part", "0/2"},
       {"--part can't be used with --append DIR"}},
      {{"partition", "v.nrrd", "--output", "d", "--part", "0/2", "--resume"},
       {"--resume can't be used with --part"}},
      {{"partition", "v.nrrd", "--output", "d", "--part", "0/2", "--distribution", "greedy"},
       {"--distribution random"}},
      {{"partition", "v.nrrd", "--finish", "d"}, {"INPUT can't be used with --finish DIR"}},
      {{"partition", "--finish", "d", "--shards", "2"}, {"--shards can't be used with --finish"}},
      {{"partition", "--finish", "d", "--levels", "2"}, {"--levels can't be used with --finish"}},
      {{"partition", "--finish", "d", "--drop-levels", "d"}, {"--finish DIR can't"}},
      {{"partition", "v.nrrd", "--output", "d", "--time", "soon"}, {"--time", "'soon'"}},
      {{"partition", "v.nrrd", "--output", "d", "--time", "inf"}, {"--time", "'inf'"}},
      {{"partition", "v.nrrd", "--output", "d", "--step", "3:1"},
       {"--step", "'3:1' is neither a step N nor a range A:B or A:B:S"}},
      {{"partition", "v.nrrd", "--output", "d", "--step", "0:9:0"}, {"--step", "'0:9:0'"}},
      {{"partition", "v.nrrd", "--output", "d", "--step", "-1"}, {"--step", "'-1'"}},
      {{"partition", "v.nrrd", "--output", "d", "--step", "0:9:1:1"}, {"--step"}},
      {{"partition", "v.nrrd", "--output", "d", "--axes", "ZYXX"}, {"--axes", "'ZYXX'", "TCZYX"}},
      {{"partition", "v.nrrd", "--output", "d", "--axes", "zyx"}, {"--axes", "'zyx'"}},
      {{"partition", "v.raw", "--dims", "4,4,4", "--type", "uint8", "--output", "d", "--axes",
        "ZYX"},
       {"--dims is for raw files only", "--axes"}},
      {{"partition", "v.raw", "--dims", "4,4,4", "--type", "uint8", "--output", "d", "--time", "1",
        "--distribution", "greedy"},
       {"--distribution greedy", "same shard in every volume"}},
      {{"verify"}, {"DIR is missing"}},
      {{"verify", "a", "b"}, {"'b' is one argument too many"}},
  };
}

// `render v.nrrd --isovalue 1 --output o.png` with `more`.
WrongUsage Render(const std::vector<std::string>& more, const std::vector<std::string>& said) {
  WrongUsage row{{"render", "v.nrrd", "--isovalue", "1", "--output", "o.png"}, said};
  row.arguments.insert(row.arguments.end(), more.begin(), more.end());
  return row;
}

WrongUsage RenderRemote(const std::vector<std::string>& more,
                        const std::vector<std::string>& said) {
  WrongUsage row{{"render", "--server", "h:1", "--isovalue", "1", "--output", "o.png"}, said};
  row.arguments.insert(row.arguments.end(), more.begin(), more.end());
  return row;
}

std::vector<WrongUsage> RenderRows() {
  return {
      {{"render"}, {"give a volume, a dataset folder or --server"}},
      {{"render", "--server", "h:1"}, {"--isovalue V is missing"}},
      {{"render", "v.nrrd", "--isovalue", "1"}, {"--output FILE.png is missing"}},
      {{"render", "v.nrrd", "--isvalue", "1", "--output", "o.png"},
       {"unknown flag --isvalue", "did you mean --isovalue"}},
      {{"render", "v.nrrd", "--isovalue", "nan", "--output", "o.png"},
       {"--isovalue", "'nan' is not a finite number"}},
      {{"render", "v.nrrd", "--isovalue", "high", "--output", "o.png"}, {"--isovalue", "'high'"}},
      Render({"--server", "h:1"}, {"can't be used with --server"}),
      Render({"--width", "0"}, {"--width", "from 1 to 65536"}),
      Render({"--height", "65537"}, {"--height", "from 1 to 65536"}),
      Render({"--region", "0,0,0,5"}, {"--region", "X,Y,W,H"}),
      Render({"--region", "1000,0,25,5"}, {"--region", "25 x 5 pixels at 1000, 0", "1024 x 1024"}),
      Render({"--quality", "80"}, {"--quality is for JPEG", ".jpg"}),
      Render({"--width", "20000", "--repeat", "2"}, {"--repeat", "20000 x 1024", "regions"}),
      Render({"--width", "20000", "--depth", "d.npy"}, {"20000 x 1024", "--region"}),
      {{"pick", "v.nrrd", "--isovalue", "1"}, {"--pixel X,Y is given 0 times", "1 to 1000"}},
      {{"pick", "v.nrrd", "--isovalue", "1", "--pixel", "1024,0"},
       {"--pixel '1024,0'", "a column from 0 to 1023"}},
      {{"pick", "v.nrrd", "--isovalue", "1", "--pixel", "1"}, {"--pixel '1' is not X,Y"}},
      {{"pick", "--isovalue", "1", "--pixel", "1", "v.nrrd"}, {"--pixel '1' is not X,Y"}},
      Render({"--eye", "1,2"}, {"--eye", "'1,2' is not X,Y,Z"}),
      Render({"--eye", "1,2,3", "--azimuth", "30"}, {"--eye can't be used with --azimuth"}),
      Render({"--up", "0,0,1", "--zoom", "2"}, {"--up can't be used with --zoom"}),
      Render({"--fov-y", "180"}, {"--fov-y", "below 180"}),
      Render({"--zoom", "0"}, {"--zoom", "above 0"}),
      Render({"--azimuth", "east"}, {"--azimuth", "'east'"}),
      Render({"--culling", "all"}, {"--culling", "'all' is none of: depth, mask, none"}),
      Render({"--renderer", "metal"}, {"--renderer", "\"metal\""}),
      Render({"--shards", "0"}, {"--shards", "'0'"}),
      Render({"--threads", "0"}, {"--threads", "'0'"}),
      Render({"--repeat", "0"}, {"--repeat", "'0'"}),
      Render({"--orbit", "5"}, {"--orbit", "--repeat N"}),
      Render({"--time", "2", "--step", "1"}, {"--time and --step exclude each other"}),
      Render({"--time", "2", "--step", "0:3"},
             {"--time and --step exclude each other: --step A:B names all steps"}),
      Render({"--timeout", "0"}, {"--timeout", "seconds above 0"}),
      Render({"--color", "1,1"}, {"--color", "a name of CSS", "R,G,B"}),
      Render({"--background", "0,0,0,2"}, {"--background", "from 0 to 1"}),
      Render({"--dims", "4,4,4", "--type", "uint8"}, {"--dims is for raw files only"}),
      Render({"--dataset", "head"}, {"--dataset is for --server"}),
      RenderRemote({"--renderer", "cpu"}, {"--renderer can't be used with --server"}),
      RenderRemote({"--shards", "2"}, {"--shards can't be used with --server"}),
      RenderRemote({"--threads", "2"}, {"--threads can't be used with --server"}),
      RenderRemote({"--cache-limit", "1G"}, {"--cache-limit can't be used with --server"}),
      Render({"--cache-limit", "0"}, {"--cache-limit", "'0' is not a size"}),
      {{"cache"}, {"'cache' is the first of two words", "cache list, cache clear"}},
      {{"cache", "lst"},
       {"'cache lst' is no command", "did you mean 'cache list'",
        "There are: cache list, cache "
        "clear"}},
      {{"cache", "zzzz"}, {"'cache zzzz' is no command. There are: cache list, cache clear"}},
      {{"cache", "--json"}, {"'cache' is the first of two words"}},
      {{"help", "cache", "lst"}, {"did you mean 'cache list'"}},
      {{"cache", "list", "x"}, {"'x' is one argument too many"}},
      RenderRemote({"--dims", "4,4,4"}, {"--dims can't be used with --server"}),
      {{"export", "--server", "h:1", "--output", "o.ply"}, {"--isovalue V is missing"}},
      {{"export", "v.nrrd", "--isovalue", "1"}, {"--output FILE is missing"}},
      {{"render", "v.nrrd", "--isovalue", "1", "--output", "a.gif"},
       {"'a.gif'", "the suffix '.gif'", ".png and .jpg, and .apng and .webp", "expected 'a.png'"}},
      {{"render", "v.nrrd", "--isovalue", "1", "--output", "f/a-%d.png.gz"},
       {"the suffix '.gz'", ".png"}},
      {{"render", "v.nrrd", "--isovalue", "1", "--output", "a.%d"}, {"the suffix '.0'", ".png"}},
      {{"export", "v.nrrd", "--isovalue", "1", "--output", "o.fbx"},
       {"'o.fbx'", "the suffix '.fbx'", ".ply, .stl, .obj, .glb, .vtp"}},
      {{"export", "v.nrrd", "--isovalue", "1", "--output", "o.stl", "--format", "ply"},
       {"'o.stl'", "--format ply"}},
      {{"render", "v.nrrd", "--isovalue", "1:3:1", "--output", "o.png"}, {"put %d into the name"}},
      {{"render", "v.nrrd", "--isovalue", "1:3", "--output", "o.png"}, {"START:STOP:STEP"}},
      {{"render", "v.nrrd", "--like", "p.png", "--output", "o.png", "--isovalue", "1"},
       {"--isovalue can't be used with --like"}},
      {{"export", "v.nrrd", "--isovalue", "1", "--output", "o.ply", "--azimuth", "1"},
       {"unknown flag --azimuth"}},
  };
}

// `generate FIELD --dims 4,4,4 --output OUTPUT` with `more`.
WrongUsage Generate(const std::string& field, const std::vector<std::string>& more,
                    const std::vector<std::string>& said, const std::string& output = "v.nrrd") {
  WrongUsage row{{"generate", field, "--dims", "4,4,4", "--output", output}, said};
  row.arguments.insert(row.arguments.end(), more.begin(), more.end());
  return row;
}
WrongUsage GenerateFlow(const std::vector<std::string>& more,
                        const std::vector<std::string>& said) {
  return Generate("flow", more, said, "f.pvd");
}

std::vector<WrongUsage> GenerateRows() {
  return {
      {{"generate"}, {"FIELD is missing", "random", "mixing"}},
      {{"generate", "gyroid"}, {"--dims X,Y,Z is missing"}},
      {{"generate", "gyroid", "--dims", "4,4,4"}, {"--output FILE is missing", ".nrrd"}},
      {{"generate", "gyroid", "--dims", "4,4,4", "--output", "v.vti"},
       {"v.vti", "unknown kind of volume file", ".nrrd", ".nhdr", ".mha", ".raw"}},
      {{"generate", "gyroid", "--dims", "4,4", "--output", "v.nrrd"}, {"--dims", "'4,4'"}},
      Generate(
          "noise", {},
          {"'noise' is none of: random, gyroid, marschner-lobb, shells, mixing, labels, flow"}),
      Generate("random", {"--type", "byte"}, {"--type", "\"byte\"", "uint8"}),
      Generate("random", {"--seed", "-1"}, {"--seed", "'-1'"}),
      Generate("random", {"--waves", "0"}, {"--waves", "'0'"}),
      Generate("random", {"--waves", "4097"}, {"--waves", "'4097'"}),
      Generate("random", {"--wave-number", "0"}, {"--wave-number", "'0'"}),
      Generate("random", {"--exponent", "inf"}, {"--exponent", "'inf'"}),
      Generate("random", {"--spacing", "0,1,1"}, {"--spacing", "above 0"}),
      Generate("random", {"--origin", "1,2"}, {"--origin", "'1,2'"}),
      Generate("random", {"--periods", "3"}, {"--periods has no meaning for the field random"}),
      Generate("gyroid", {"--periods", "-1"}, {"--periods", "'-1'"}),
      Generate("gyroid", {"--waves", "3"}, {"--waves has no meaning for the field gyroid"}),
      Generate("gyroid", {"--thickness", "1"}, {"--thickness has no meaning for the field gyroid"}),
      Generate("shells", {"--shells", "1001"}, {"--shells", "'1001'"}),
      Generate("shells", {"--frequency", "3"}, {"--frequency has no meaning for the field shells"}),
      Generate("mixing", {"--alpha", "1"}, {"--alpha has no meaning for the field mixing"}),
      Generate("mixing", {"--shells", "3"}, {"--shells has no meaning for the field mixing"}),
      Generate("mixing", {"--regions", "3"}, {"--regions has no meaning for the field mixing"}),
      Generate("labels", {"--regions", "101"}, {"--regions", "'101'"}),
      Generate("random", {"--steps", "3"}, {"--steps has no meaning for the field random"}),
      Generate("random", {"--time-step", "3"}, {"--time-step has no meaning for the field random"}),
      Generate("random", {"--threads", "0"}, {"--threads", "'0'"}),
      Generate("flow", {}, {"v.nrrd", "expected a name that ends in .pvd"}),
      {{"generate", "flow", "--dims", "4,4,4"}, {"--output FILE.pvd is missing"}},
      GenerateFlow({}, {"--steps N is missing"}),
      GenerateFlow({"--steps", "0"}, {"--steps", "'0'"}),
      GenerateFlow({"--steps", "100001"}, {"--steps", "'100001'"}),
      GenerateFlow({"--time-step", "0"}, {"--time-step", "'0'"}),
      GenerateFlow({"--type", "uint8"}, {"--type has no meaning for the field flow"}),
      GenerateFlow({"--seed", "1"}, {"--seed has no meaning for the field flow"}),
      GenerateFlow({"--spacing", "1,1,1"}, {"--spacing has no meaning for the field flow"}),
      GenerateFlow({"--origin", "1,1,1"}, {"--origin has no meaning for the field flow"}),
  };
}

INSTANTIATE_TEST_SUITE_P(General, WrongUsageTest, ::testing::ValuesIn(GeneralRows()));
INSTANTIATE_TEST_SUITE_P(Generate, WrongUsageTest, ::testing::ValuesIn(GenerateRows()));
INSTANTIATE_TEST_SUITE_P(Partition, WrongUsageTest, ::testing::ValuesIn(PartitionRows()));
INSTANTIATE_TEST_SUITE_P(Render, WrongUsageTest, ::testing::ValuesIn(RenderRows()));

TEST(CommandTest, VersionIsOneLine) {
  const Outcome outcome = RunCli({"--version"});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.out, absl::StrCat("isoscope ", base::Version(), "\n"));
}

TEST(CommandTest, HelpListsEveryCommand) {
  for (const char* flag : {"--help", "-h", "help"}) {
    const Outcome outcome = RunCli({flag});
    EXPECT_EQ(outcome.exit_code, 0);
    for (const Command& command : IsoscopeProgram().commands) {
      EXPECT_THAT(outcome.out, HasSubstr("  " + command.name));
    }
  }
}

// The text with single spaces in place of line ends and indents.
std::string Unwrapped(const std::string& text) {
  return absl::StrJoin(absl::StrSplit(text, absl::ByAnyChar(" \n"), absl::SkipEmpty()), " ");
}

TEST(CommandTest, HelpOfACommandHasExamplesAndDefaults) {
  for (const Command& command : IsoscopeProgram().commands) {
    std::vector<std::string> arguments = absl::StrSplit(command.name, ' ');
    arguments.emplace_back("--help");
    const Outcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_THAT(Unwrapped(outcome.out),
                HasSubstr(Unwrapped("Usage: isoscope " + command.name + " " + command.usage)));
    EXPECT_EQ(outcome.out.find("Usage:"), outcome.out.rfind("Usage:"));
    EXPECT_THAT(outcome.out, HasSubstr("Examples:\n  isoscope " + command.name));
    EXPECT_THAT(outcome.out, HasSubstr("default:"));
    EXPECT_EQ(RunCli({"help", command.name}).out, outcome.out);
  }
}

TEST(CommandTest, EveryFlagStandsUnderAHeadingOfTheLayout) {
  for (const CommandDescription& command : DescribeProgram(IsoscopeProgram()).commands) {
    for (const FlagDescription& flag : command.flags) {
      EXPECT_NE(flag.group, "Options")
          << command.name << " " << KeyOf(flag) << ": give it a heading in help_layout.cc";
    }
  }
}

TEST(CommandTest, TheCommonFlagsOfACommandExist) {
  const Program program = IsoscopeProgram();
  std::size_t found = 0;
  for (const CommandDescription& command : DescribeProgram(program).commands) {
    const auto common = program.help.common.find(command.name);
    if (common == program.help.common.end()) {
      continue;
    }
    ++found;
    std::vector<std::string> keys;
    for (const FlagDescription& flag : command.flags) {
      keys.push_back(KeyOf(flag));
    }
    EXPECT_THAT(keys, ::testing::IsSupersetOf(common->second)) << command.name;
    EXPECT_GT(keys.size(), common->second.size()) << command.name << ": nothing is left out";
  }
  EXPECT_EQ(found, program.help.common.size()) << "a command of that name is missing";
}

TEST(CommandTest, LongHelpShowsWhatIsCommonAndHelpAllTheRest) {
  const std::string help = RunCli({"render", "--help"}).out;
  EXPECT_THAT(help, HasSubstr("--isovalue "));
  EXPECT_THAT(help, ::testing::Not(HasSubstr("--tls-ca ")));
  EXPECT_LT(help.find("\nInput:\n"), help.find("\nSurfaces:\n"));
  EXPECT_THAT(help, HasSubstr("\n--help-all lists "));
  const std::string all = RunCli({"render", "--help-all"}).out;
  EXPECT_THAT(all, HasSubstr("--tls-ca "));
  EXPECT_LT(all.find("--isovalue "), all.find("--tls-ca "));
  EXPECT_LT(2 * help.size(), all.size());
  EXPECT_EQ(RunCli({"render", "--no-such-flag", "--help-all"}).out, all) << "as --help, it wins";
}

// Symptom: the statistics of a quick picture of a level took minutes.
TEST(CommandTest, HelpSaysWhatMeasuresOfAPictureCost) {
  const std::string help = absl::StrJoin(absl::StrSplit(RunCli({"render", "--help-all"}).out,
                                                        absl::ByAnyChar(" \n"), absl::SkipEmpty()),
                                         " ");
  const std::string of_stats = help.substr(help.find("--stats FILE|- "), 400);
  EXPECT_THAT(of_stats, HasSubstr("at level 0, whatever level is drawn"));
  EXPECT_THAT(of_stats, HasSubstr("as long as an export"));
  EXPECT_THAT(help, HasSubstr("without areas and volumes, which are of level 0 and take as long"));
}

TEST(CommandTest, WordsForShellsAreOfFlagsThatExist) {
  const Program program = IsoscopeProgram();
  const ProgramDescription description = DescribeProgram(program);
  for (const ValueWords& words : program.words) {
    EXPECT_FALSE(words.words.empty()) << words.flag;
    bool is_used = false;
    for (const CommandDescription& command : description.commands) {
      for (const FlagDescription& flag : command.flags) {
        is_used = is_used || (KeyOf(flag) == words.flag &&
                              (words.value_name.empty() || words.value_name == flag.value_name));
      }
    }
    EXPECT_TRUE(is_used) << words.flag << " " << words.value_name;
  }
}

// The flags that scripts outside of the repository use.
TEST(CommandTest, TheFlagsOfTheContractExist) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> contract = {
      {"partition",
       {"--output", "--shards", "--block-cells", "--distribution", "--seed", "--memory-limit",
        "--dims", "--type", "--spacing", "--origin", "--endian", "--header-bytes", "--levels",
        "--add-levels", "--drop-levels"}},
      {"info", {"--server", "--json"}},
      {"serve", {"--listen"}},
      {"render",
       {"--server", "--isovalue", "--output", "--width", "--height", "--eye", "--target", "--up",
        "--fov-y", "--azimuth", "--elevation", "--zoom", "--culling", "--renderer", "--shards",
        "--threads", "--repeat", "--orbit", "--stats"}},
      {"export", {"--server", "--isovalue", "--output"}}};
  for (const auto& [command, flags] : contract) {
    const std::string help = RunCli({command, "--help-all"}).out;
    for (const std::string& flag : flags) {
      EXPECT_THAT(help, HasSubstr(flag + " ")) << command;
    }
  }
}

TEST(CommandTest, FailedRequestsExitWithOneAndNameTheCode) {
  const TempDir folder;
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"info", folder.Sub("absent")},
           {"serve", folder.Sub("absent"), "--listen", "127.0.0.1:0"},
           {"partition", folder.Sub("absent.nrrd"), "--output", folder.Sub("d")},
           {"render", folder.Sub("absent.nrrd"), "--isovalue", "1", "--output",
            folder.Sub("o.png")},
           {"render", folder.path(), "--isovalue", "1", "--output", folder.Sub("o.png")},
           {"export", folder.Sub("absent"), "--isovalue", "1", "--output", folder.Sub("o.ply")}}) {
    const Outcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 1) << arguments[0];
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(outcome.err, StartsWith("isoscope: NOT_FOUND: "));
    EXPECT_EQ(outcome.err.find('\n'), outcome.err.size() - 1) << outcome.err;
  }
}

TEST(CommandTest, AMissingFileIsNamedBeforeAMissingIsovalue) {
  const TempDir folder;
  const std::string absent = folder.Sub("absent.nrrd");
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"render", absent}, {"export", absent}, {"pick", absent}}) {
    const Outcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 1) << arguments[0];
    EXPECT_THAT(outcome.err, StartsWith("isoscope: NOT_FOUND: ")) << arguments[0];
    EXPECT_THAT(outcome.err, HasSubstr("absent.nrrd")) << arguments[0];
  }
  // A file that is there: it is the isovalue that is missing.
  const std::string there = folder.Sub("there.nrrd");
  std::ofstream(there) << "NRRD0001\n";
  const Outcome outcome = RunCli({"render", there});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("--isovalue V is missing"));
}

TEST(CommandTest, UnwritableOutputIsFoundBeforeAnyWork) {
  const TempDir folder;
  const Outcome outcome = RunCli({"render", folder.Sub("absent.nrrd"), "--isovalue", "1",
                                  "--output", folder.Sub("no/such/folder/o.png")});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("no/such/folder/o.png"));
}

TEST(CommandTest, AbsentServerIsNamedWithAWayToStartOne) {
  const TempDir folder;
  // Port 1 needs privileges to listen on, and nothing of ours does.
  const Outcome outcome = RunCli({"render", "--server", "127.0.0.1:1", "--isovalue", "-.5",
                                  "--output", folder.Sub("o.png"), "--timeout", "5"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err,
              StartsWith("isoscope: UNAVAILABLE: no coordinator answers at 127.0.0.1:1"));
  EXPECT_THAT(outcome.err, HasSubstr("isoscope serve"));
}

class GenerateTest : public ::testing::Test {
 protected:
  // The bytes that `generate FIELD --dims 24,20,16` writes with `more`; the samples alone.
  std::string Bytes(const std::string& field, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"generate", field,      "--dims",
                                       "24,20,16", "--output", folder_.Sub("bytes.raw")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return io::ReadWholeFile(folder_.Sub("bytes.raw"), base::kMiB).value_or("");
  }

  TempDir folder_;
};

TEST_F(GenerateTest, EveryFieldInEveryKindOfFileIsAVolumeForPartition) {
  for (const char* field : {"random", "gyroid", "marschner-lobb", "shells", "mixing", "labels"}) {
    for (const char* ending : {".nrrd", ".nhdr", ".mha", ".raw"}) {
      SCOPED_TRACE(absl::StrCat(field, ending));
      const std::string path = folder_.Sub(absl::StrCat(field, ending));
      const std::string dataset = path + ".d";
      const std::vector<std::string> geometry{"--dims",   "24,20,16", "--spacing", "1,0.5,2",
                                              "--origin", "-3,4,5",   "--type",    "uint8"};
      std::vector<std::string> generate{"generate", field, "--output", path};
      generate.insert(generate.end(), geometry.begin(), geometry.end());
      const Outcome generated = RunCli(generate);
      ASSERT_EQ(generated.exit_code, 0) << generated.err;
      EXPECT_THAT(generated.out, HasSubstr("24 x 20 x 16 samples of uint8"));
      EXPECT_THAT(generated.out, HasSubstr(field == std::string("labels") ? "labels 1 to 12"
                                                                          : "middle value 127.5"));

      std::vector<std::string> partition{"partition", path, "--output", dataset};
      if (absl::EndsWith(path, ".raw")) {
        partition.insert(partition.end(), geometry.begin(), geometry.end());
      }
      const Outcome partitioned = RunCli(partition);
      ASSERT_EQ(partitioned.exit_code, 0) << partitioned.err;
      const absl::StatusOr<store::DatasetDescription> description = store::OpenDataset(dataset);
      ASSERT_TRUE(description.ok()) << description.status();
      const store::Manifest& manifest = description->manifest;
      EXPECT_EQ(manifest.scalar_type, volume::ScalarType::kUint8);
      EXPECT_EQ(manifest.geometry.sample_dims, (math::Index3{24, 20, 16}));
      EXPECT_EQ(manifest.geometry.spacing, (math::Vec3d{1, 0.5, 2}));
      EXPECT_EQ(manifest.geometry.origin, (math::Vec3d{-3, 4, 5}));
      // There is a surface at the level that the command names.
      const double level = field == std::string("labels") ? 11.5 : 127.5;
      EXPECT_LT(manifest.value_range.min, level);
      EXPECT_GT(manifest.value_range.max, level);
    }
  }
}

TEST_F(GenerateTest, FlowIsACollectionOfSteps) {
  const auto generate = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"generate", "flow", "--dims",   "24,20,16",
                                       "--steps",  "3",    "--output", folder_.Sub(name)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunCli(arguments);
  };
  const auto bytes = [&](const std::string& name) {
    return io::ReadWholeFile(folder_.Sub(name), base::kMiB).value_or("");
  };
  const Outcome outcome = generate("f.pvd", {});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              HasSubstr("f.pvd: flow, 24 x 20 x 16 samples, pressure [Pa], temperature [K], "
                        "velocity [m/s], 3 steps of 0.1 s, 0.4 MiB, in "));
  EXPECT_THAT(bytes("f.pvd"), HasSubstr("timestep=\"0.2\""));
  EXPECT_EQ(generate("g.pvd", {"--threads", "1"}).exit_code, 0);
  EXPECT_EQ(generate("h.pvd", {"--time-step", "0.2"}).exit_code, 0);
  for (const char* step : {"00000", "00001", "00002"}) {
    EXPECT_FALSE(bytes(absl::StrCat("f_", step, ".vti")).empty());
    EXPECT_EQ(bytes(absl::StrCat("f_", step, ".vti")), bytes(absl::StrCat("g_", step, ".vti")));
  }
  EXPECT_EQ(bytes("f_00002.vti"), bytes("h_00001.vti"));
  EXPECT_NE(bytes("f_00001.vti"), bytes("h_00001.vti"));
}

TEST_F(GenerateTest, InterruptedFlowLeavesNothing) {
  Interrupt interrupt;
  interrupt.Trigger();
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(RunProgram(IsoscopeProgram(),
                       {"generate", "flow", "--dims", "8,8,8", "--steps", "2", "--output",
                        folder_.Sub("f.pvd")},
                       {.out = &out, .err = &err, .interrupt = &interrupt}),
            1);
  EXPECT_THAT(err.str(), HasSubstr("interrupted while generating; nothing was left behind"));
  EXPECT_EQ(out.str(), "");
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(GenerateTest, SeedAloneDecidesAboutChance) {
  for (const char* field : {"random", "mixing"}) {
    const std::string bytes = Bytes(field, {});
    EXPECT_EQ(bytes.size(), 24U * 20 * 16 * 2) << "uint16 by default";
    EXPECT_EQ(Bytes(field, {"--seed", "1"}), bytes) << field;
    EXPECT_NE(Bytes(field, {"--seed", "2"}), bytes) << field;
    EXPECT_EQ(Bytes(field, {"--seed", "2"}), Bytes(field, {"--seed", "2"})) << field;
  }
}

TEST_F(GenerateTest, EveryFlagOfAFieldChangesIt) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> rows = {
      {"random", {"--waves", "8"}},
      {"random", {"--wave-number", "6"}},
      {"random", {"--exponent", "1"}},
      {"mixing", {"--waves", "8"}},
      {"mixing", {"--thickness", "0.2"}},
      {"gyroid", {"--periods", "3"}},
      {"marschner-lobb", {"--frequency", "3"}},
      {"marschner-lobb", {"--alpha", "0.5"}},
      {"shells", {"--shells", "2"}},
      {"labels", {"--regions", "3"}},
      {"labels", {"--seed", "2"}},
      {"labels", {"--type", "uint16"}},
      {"gyroid", {"--type", "float32"}},
  };
  for (const auto& [field, flags] : rows) {
    EXPECT_NE(Bytes(field, flags), Bytes(field, {})) << field << " " << flags[0];
  }
}

}  // namespace
}  // namespace isoscope::cli
