#include "clients/cpp/request/effect_flags.h"

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/message.h"

#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/frame/drawn_window.h"
#include "isoscope/v1/options.pb.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

absl::StatusOr<std::int64_t> ParseSamples(absl::string_view text) {
  return ParseChoice<std::int64_t>(text, {{"1", 1}, {"4", 4}, {"9", 9}, {"16", 16}});
}

bool IsColor(const FieldDescriptor& value) {
  return value.message_type() == v1::Color::descriptor();
}

char SeparatorBefore(const FieldDescriptor& value) { return IsColor(value) ? ':' : ','; }

// "radius_px" -> "radius".
absl::string_view NameOf(const FieldDescriptor& value) {
  return absl::StripSuffix(value.name(), "_px");
}

// "[WIDTH[:COLOR]]"
std::string PlaceholderOf(const Descriptor& effect) {
  std::string text;
  for (int i = 0; i < effect.field_count(); ++i) {
    const FieldDescriptor& value = *effect.field(i);
    absl::StrAppend(&text, "[", i == 0 ? "" : std::string(1, SeparatorBefore(value)),
                    absl::AsciiStrToUpper(NameOf(value)));
  }
  return absl::StrCat(text, std::string(static_cast<std::size_t>(effect.field_count()), ']'));
}

std::string HelpOf(const FieldDescriptor& effect) {
  std::vector<std::string> values;
  for (int i = 0; i < effect.message_type()->field_count(); ++i) {
    const v1::ValueOptions& options =
        effect.message_type()->field(i)->options().GetExtension(v1::value_options);
    values.push_back(absl::StrCat(
        absl::StrReplaceAll(options.help(),
                            {{"{}", absl::StrCat(options.min(), " to ", options.max())}}),
        " (default: ", options.default_text(), ")"));
  }
  return absl::StrCat(effect.options().GetExtension(v1::effect_options).help(), ": ",
                      absl::StrJoin(values, ", and "));
}

// Writes `part` of `text` into the effect.
absl::Status SetValue(absl::string_view text, absl::string_view part, const FieldDescriptor& value,
                      Message* effect) {
  const google::protobuf::Reflection& reflection = *effect->GetReflection();
  const v1::ValueOptions& options = value.options().GetExtension(v1::value_options);
  if (IsColor(value)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const frame::Color color, ParseColor(part));
    reflection.MutableMessage(effect, &value)->CopyFrom(ToProto(color));
  } else if (value.cpp_type() == FieldDescriptor::CPPTYPE_INT32) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t number,
                              ParseInteger(part, static_cast<std::int64_t>(options.min()),
                                           static_cast<std::int64_t>(options.max())));
    reflection.SetInt32(effect, &value, static_cast<std::int32_t>(number));
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(const double number, ParseNumber(part));
    if (number < options.min() || number > options.max()) {
      return absl::InvalidArgumentError(absl::StrCat(base::Quoted(text, '\''), " has the ",
                                                     NameOf(value), " ", number, ": must be in [",
                                                     options.min(), ", ", options.max(), "]"));
    }
    reflection.SetFloat(effect, &value, static_cast<float>(number));
  }
  return absl::OkStatus();
}

absl::Status ParseEffect(absl::string_view text, Message* effect) {
  const Descriptor& type = *effect->GetDescriptor();
  effect->Clear();
  absl::string_view rest = text;
  for (int i = 0; i < type.field_count() && !text.empty(); ++i) {
    const std::size_t end = i + 1 < type.field_count()
                                ? rest.find(SeparatorBefore(*type.field(i + 1)))
                                : absl::string_view::npos;
    ISOSCOPE_RETURN_IF_ERROR(SetValue(text, rest.substr(0, end), *type.field(i), effect));
    if (end == absl::string_view::npos) {
      break;
    }
    rest.remove_prefix(end + 1);
  }
  return absl::OkStatus();
}

}  // namespace

int EffectFlags::samples_per_side() const {
  int side = 1;
  while (side * side < samples.value_or(1)) {
    ++side;
  }
  return side;
}

view::Viewport EffectFlags::drawn_size(const view::Viewport& size) const {
  return {size.width_px * samples_per_side(), size.height_px * samples_per_side()};
}

int EffectFlags::max_region_side_px() const {
  return view::kMaxViewportPx / samples_per_side() - 2 * frame::kMaxMarginPx;
}

void AddEffectFlags(cli::FlagSet* set, EffectFlags* flags) {
  const std::string group = "Effects";
  cli::AddFlag(
      set, "--samples", "1|4|9|16", &flags->samples, ParseSamples,
      "smooth edges: each pixel is the mean of this many samples (default: 1 if a flag of the "
      "camera is given, else 4)")
      .Group(group);
  const Descriptor& request = *v1::RenderIsosurfaceRequest::descriptor();
  for (int i = 0; i < request.field_count(); ++i) {
    const FieldDescriptor& effect = *request.field(i);
    if (!effect.options().HasExtension(v1::effect_options)) {
      continue;
    }
    const auto parse = [flags, &effect](absl::string_view text) {
      v1::RenderIsosurfaceRequest& effects = flags->effects;
      return ParseEffect(text, effects.GetReflection()->MutableMessage(&effects, &effect));
    };
    set->AddOptional(absl::StrCat("--", absl::StrReplaceAll(effect.name(), {{"_", "-"}})),
                     PlaceholderOf(*effect.message_type()), parse, HelpOf(effect))
        .Group(group);
  }
}

void SetEffects(const EffectFlags& flags, v1::RenderIsosurfaceRequest* request) {
  if (flags.samples) {
    request->set_samples(static_cast<std::int32_t>(*flags.samples));
  }
  request->MergeFrom(flags.effects);
}

}  // namespace isoscope::client
