#include "server/access/access_tokens.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "nlohmann/json.hpp"
#include <openssl/sha.h>

#include "core/base/status_macros.h"
#include "core/view/camera.h"

namespace isoscope::server {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxNameBytes = 100;
constexpr double kMaxFramesPerSecond = 1e6;
constexpr double kMaxBytesPerSecond = 1e15;
constexpr int kMaxAtATime = 1'000'000;
constexpr char kAllDatasets[] = "*";

absl::Status Wrong(absl::string_view where, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(where, ": ", what));
}

bool IsText(const Json& value, std::size_t max_bytes) {
  return value.is_string() && !value.get_ref<const std::string&>().empty() &&
         value.get_ref<const std::string&>().size() <= max_bytes;
}

absl::Status ReadDigest(const Json& value, absl::string_view where, std::string* digest) {
  const std::string text = value.is_string() ? value.get<std::string>() : "";
  const bool is_hex = std::all_of(text.begin(), text.end(), [](char c) {
    return absl::ascii_isxdigit(static_cast<unsigned char>(c));
  });
  if (text.size() != 2 * SHA256_DIGEST_LENGTH || !is_hex) {
    return Wrong(where,
                 "sha256 must be the 64 hexadecimal digits that `sha256sum` prints for the "
                 "token without a line feed");
  }
  *digest = absl::HexStringToBytes(text);
  return absl::OkStatus();
}

absl::Status ReadDatasets(const Json& value, absl::string_view where, AccessToken* token) {
  constexpr std::size_t kMaxDatasetNameBytes = 1024;
  const bool is_list = value.is_array() && !value.empty() &&
                       std::all_of(value.begin(), value.end(), [](const Json& name) {
                         return IsText(name, kMaxDatasetNameBytes);
                       });
  if (!is_list) {
    return Wrong(where, "datasets must be a list of names, or [\"*\"] for all");
  }
  for (const Json& name : value) {
    token->datasets.push_back(name.get<std::string>());
  }
  std::vector<std::string>& names = token->datasets;
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  if (std::find(names.begin(), names.end(), kAllDatasets) == names.end()) {
    return absl::OkStatus();
  }
  if (names.size() > 1) {
    return Wrong(where, "datasets has \"*\" beside names: it must stand alone, for all");
  }
  token->sees_all_datasets = true;
  names.clear();
  return absl::OkStatus();
}

absl::Status ReadRate(const Json& value, absl::string_view where, absl::string_view key,
                      double most, double* rate) {
  if (!value.is_number() || !(value.get<double>() > 0) || value.get<double>() > most) {
    return Wrong(where, absl::StrCat(key, " must be a number above 0"));
  }
  *rate = value.get<double>();
  return absl::OkStatus();
}

absl::Status ReadCount(const Json& value, absl::string_view where, absl::string_view key,
                       int* count) {
  if (!value.is_number_integer() || value.get<double>() < 1 || value.get<double>() > kMaxAtATime) {
    return Wrong(where, absl::StrCat(key, " must be a whole number from 1 to ", kMaxAtATime));
  }
  *count = value.get<int>();
  return absl::OkStatus();
}

absl::Status ReadMember(const std::string& key, const Json& value, absl::string_view where,
                        AccessToken* token) {
  if (key == "name") {
    if (!IsText(value, kMaxNameBytes)) {
      return Wrong(where, absl::StrCat("name must be a text of 1 to ", kMaxNameBytes, " bytes"));
    }
    token->name = value.get<std::string>();
  } else if (key == "sha256") {
    return ReadDigest(value, where, &token->digest);
  } else if (key == "datasets") {
    return ReadDatasets(value, where, token);
  } else if (key == "max_viewport_px") {
    if (!value.is_number_integer() || value.get<double>() < 1 ||
        value.get<double>() > view::kMaxViewportPx) {
      return Wrong(where, absl::StrCat("max_viewport_px must be a whole number from 1 to ",
                                       view::kMaxViewportPx));
    }
    token->max_viewport_px = value.get<int>();
  } else if (key == "max_frames_per_second") {
    return ReadRate(value, where, key, kMaxFramesPerSecond, &token->max_frames_per_second);
  } else if (key == "max_bytes_per_second") {
    return ReadRate(value, where, key, kMaxBytesPerSecond, &token->max_bytes_per_second);
  } else if (key == "max_concurrent_frames") {
    return ReadCount(value, where, key, &token->max_concurrent_frames);
  } else if (key == "max_streams") {
    return ReadCount(value, where, key, &token->max_streams);
  } else if (key == "max_exports") {
    return ReadCount(value, where, key, &token->max_exports);
  } else {
    return Wrong(where, absl::StrCat("there is no member \"", absl::CHexEscape(key),
                                     "\": name, sha256, datasets, max_viewport_px, "
                                     "max_frames_per_second, max_concurrent_frames, max_streams, "
                                     "max_exports, max_bytes_per_second"));
  }
  return absl::OkStatus();
}

absl::StatusOr<AccessToken> ReadToken(const Json& entry, absl::string_view where) {
  if (!entry.is_object()) {
    return Wrong(where, "must be an object");
  }
  AccessToken token;
  for (const auto& [key, value] : entry.items()) {
    ISOSCOPE_RETURN_IF_ERROR(ReadMember(key, value, where, &token));
  }
  if (token.name.empty() || token.digest.empty() || !entry.contains("datasets")) {
    return Wrong(where, "name, sha256 and datasets are required");
  }
  return token;
}

}  // namespace

absl::StatusOr<std::vector<AccessToken>> ParseAccessTokens(absl::string_view text,
                                                           absl::string_view where) {
  const Json json = Json::parse(text.begin(), text.end(), nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || json.size() != 1 || !json.contains("tokens") ||
      !json["tokens"].is_array()) {
    return Wrong(where, "must be a JSON object with one member, \"tokens\": [...]");
  }
  const Json& entries = json["tokens"];
  if (entries.size() > kMaxAccessTokens) {
    return Wrong(where,
                 absl::StrCat("has ", entries.size(), " tokens: at most ", kMaxAccessTokens));
  }
  std::vector<AccessToken> tokens;
  std::set<std::string> names;
  std::set<std::string> digests;
  for (const Json& entry : entries) {
    const std::string place = absl::StrCat(where, ": tokens[", tokens.size(), "]");
    ISOSCOPE_ASSIGN_OR_RETURN(AccessToken token, ReadToken(entry, place));
    if (!names.insert(token.name).second || !digests.insert(token.digest).second) {
      return Wrong(place, "another entry has the same name or the same sha256");
    }
    tokens.push_back(std::move(token));
  }
  return tokens;
}

std::string DigestOfToken(absl::string_view token) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest{};
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest.data());
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

}  // namespace isoscope::server
