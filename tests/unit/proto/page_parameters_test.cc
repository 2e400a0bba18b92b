// clients/web/parameters.js: what the page knows of colour maps and effects, as the protos have it.
//
//   ISOSCOPE_REGENERATE_PAGE=1 build/release/tests/page_parameters_test     writes it

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "google/protobuf/descriptor.h"
#include "gtest/gtest.h"

#include "isoscope/v1/geometry.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "isoscope/v1/options.pb.h"

namespace isoscope {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;

constexpr char kHead[] =
    R"(// Colour maps, effects and the first look, as the protos have them (isoscope/v1/options.proto).
// Written by page_parameters_test, with ISOSCOPE_REGENERATE_PAGE=1. Do not edit.
// @ts-check

/**
 * @typedef {object} EffectValue
 * @property {string} json name in messages
 * @property {'whole' | 'number' | 'color'} kind
 * @property {string} initial default, as people write it
 */
/**
 * @typedef {object} Effect
 * @property {string} flag
 * @property {string} json name in messages
 * @property {string} title
 * @property {EffectValue[]} values in the order in which people write them; the first is a number
 */

)";

std::string ColorMaps() {
  const EnumDescriptor& maps = *v1::ColorMap_descriptor();
  std::string text = "export const COLOR_MAPS = [";
  for (int i = 1; i < maps.value_count(); ++i) {
    const absl::string_view name = absl::StripPrefix(maps.value(i)->name(), "COLOR_MAP_");
    absl::StrAppend(&text, i == 1 ? "'" : ", '",
                    absl::StrReplaceAll(absl::AsciiStrToLower(name), {{"_", "-"}}), "'");
  }
  return absl::StrCat(text, "];\n");
}

std::string KindOf(const FieldDescriptor& value) {
  return value.message_type() == v1::Color::descriptor()      ? "color"
         : value.cpp_type() == FieldDescriptor::CPPTYPE_INT32 ? "whole"
         : value.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT ? "number"
                                                              : "unknown";
}

std::string Effects() {
  std::string text = "/** @type {Effect[]} */\nexport const EFFECTS = [\n";
  const Descriptor& request = *v1::RenderIsosurfaceRequest::descriptor();
  for (int i = 0; i < request.field_count(); ++i) {
    const FieldDescriptor& effect = *request.field(i);
    if (!effect.options().HasExtension(v1::effect_options)) {
      continue;
    }
    absl::StrAppend(&text, "  { flag: '", absl::StrReplaceAll(effect.name(), {{"_", "-"}}),
                    "', json: '", effect.json_name(), "', title: '",
                    effect.options().GetExtension(v1::effect_options).title(), "', values: [\n");
    for (int k = 0; k < effect.message_type()->field_count(); ++k) {
      const FieldDescriptor& value = *effect.message_type()->field(k);
      absl::StrAppend(&text, "    { json: '", value.json_name(), "', kind: '", KindOf(value),
                      "', initial: '",
                      value.options().GetExtension(v1::value_options).default_text(), "' },\n");
    }
    absl::StrAppend(&text, "  ] },\n");
  }
  return absl::StrCat(text, "];\n");
}

std::string FirstLook() {
  const v1::FirstLook& look =
      v1::RenderIsosurfaceRequest::descriptor()->options().GetExtension(v1::first_look);
  return absl::StrCat("/** What is asked for where people ask for no camera. */\n",
                      "export const FIRST_LOOK = { samples: ", look.samples(),
                      ", material: { diffuse: ", look.diffuse(), ", specular: ", look.specular(),
                      ", shininess: ", look.shininess(), " } };\n");
}

TEST(PageParametersTest, ThePageKnowsTheMapsEffectsAndFirstLookOfTheProtos) {
  const std::string expected = absl::StrCat(kHead, ColorMaps(), Effects(), FirstLook());
  if (std::getenv("ISOSCOPE_REGENERATE_PAGE") != nullptr) {
    std::ofstream(ISOSCOPE_PAGE_PARAMETERS) << expected;
  }
  std::stringstream written;
  written << std::ifstream(ISOSCOPE_PAGE_PARAMETERS).rdbuf();
  EXPECT_EQ(written.str(), expected)
      << "the protos have changed: run this test with ISOSCOPE_REGENERATE_PAGE=1";
}

// The flags, Python and the page read a first number, and any limits, without a look at the type.
TEST(PageParametersTest, EachEffectCanBeWrittenAsText) {
  const Descriptor& request = *v1::RenderIsosurfaceRequest::descriptor();
  for (int i = 0; i < request.field_count(); ++i) {
    const FieldDescriptor& effect = *request.field(i);
    if (!effect.options().HasExtension(v1::effect_options)) {
      continue;
    }
    EXPECT_NE(effect.options().GetExtension(v1::effect_options).help(), "") << effect.name();
    for (int k = 0; k < effect.message_type()->field_count(); ++k) {
      const FieldDescriptor& value = *effect.message_type()->field(k);
      const v1::ValueOptions& options = value.options().GetExtension(v1::value_options);
      EXPECT_NE(options.default_text(), "") << value.full_name();
      EXPECT_NE(options.help(), "") << value.full_name();
      const std::string kind = KindOf(value);
      EXPECT_EQ(kind == "color", options.max() <= options.min()) << value.full_name();
      EXPECT_TRUE(kind == "whole" || (kind != "unknown" && k > 0)) << value.full_name();
    }
  }
}

}  // namespace
}  // namespace isoscope
