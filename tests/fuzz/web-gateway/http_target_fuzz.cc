// Fuzzes a browser's input without its transport: addresses, the parameters of pictures, films and
// meshes, the messages of a WebSocket, and the headers for access. The first byte selects one.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include <arpa/inet.h>

#include "rpc/peer.h"
#include "tests/fuzz/fuzz_input.h"
#include "web-gateway/api/film_answer.h"
#include "web-gateway/api/frame_message.h"
#include "web-gateway/api/json.h"
#include "web-gateway/api/render_query.h"
#include "web-gateway/api/served_selection.h"
#include "web-gateway/http/access.h"
#include "web-gateway/http/url.h"
#include "wire/field_selection.h"
#include "wire/frame_convert.h"

namespace isoscope::fuzz {
namespace {

namespace v1 = isoscope::v1;

v1::Dataset MakeDataset() {
  v1::Dataset dataset;
  dataset.set_name("head");
  v1::GridGeometry* const geometry = dataset.mutable_geometry();
  geometry->mutable_sample_dims()->set_x(11);
  geometry->mutable_sample_dims()->set_y(11);
  geometry->mutable_sample_dims()->set_z(11);
  geometry->mutable_spacing()->set_x(1);
  geometry->mutable_spacing()->set_y(1);
  geometry->mutable_spacing()->set_z(1);
  for (int step = 0; step < 3; ++step) {
    v1::TimeStep& time = *dataset.add_time_steps();
    time.set_number(2 * step);
    time.set_value(step);
  }
  for (const char* const name : {"pressure", "velocity"}) {
    v1::Field& field = *dataset.add_fields();
    field.set_name(name);
    field.add_components()->set_name(name[0] == 'v' ? "x" : "");
    field.add_time_steps(0);
    field.add_time_steps(2);
  }
  return dataset;
}

void ReadHistogram(const gateway::QueryParameters& query, const v1::Dataset& dataset) {
  const auto histogram = gateway::HistogramRequestFromQuery(query, dataset);
  if (!histogram.ok()) {
    RequireError(histogram.status(), {absl::StatusCode::kInvalidArgument});
  } else {
    Require(histogram->max_bin_count() <= 4096, "a histogram has few bins");
  }
}

void ReadFilm(const gateway::QueryParameters& query, const v1::Dataset& dataset) {
  const auto film = gateway::FilmQueryFromQuery(query, dataset);
  if (!film.ok()) {
    RequireError(film.status(), {absl::StatusCode::kInvalidArgument});
    return;
  }
  if (gateway::CheckFilm(client::AnimationFormat::kWebp, *film).ok()) {
    v1::RenderIsosurfaceRequest last = film->first;
    const int count = film->sweep.frame_count();
    Require(count <= gateway::kMaxFilmFrames, "a film has few frames");
    const absl::Status status = client::SetFrame(film->sweep, count - 1, &last);
    if (!status.ok()) {
      RequireError(status, {absl::StatusCode::kInvalidArgument});
    }
  }
}

void ReadTarget(absl::string_view text) {
  const auto target = gateway::ParseTarget(text);
  if (!target.ok()) {
    RequireError(target.status(), {absl::StatusCode::kInvalidArgument});
    return;
  }
  for (const std::string& segment : target->segments) {
    Require(segment != "." && segment != "..", "no segment leads out of its folder");
    Require(std::none_of(segment.begin(), segment.end(),
                         [](char c) { return static_cast<unsigned char>(c) < 0x20; }),
            "no segment has a control character");
  }
  Require(target->query.size() <= gateway::kMaxQueryParameters, "a query has few parameters");
  std::string again = "/";
  for (std::size_t i = 0; i < target->query.size(); ++i) {
    absl::StrAppend(&again, i == 0 ? "?" : "&", gateway::EscapeQueryValue(target->query[i].first),
                    "=", gateway::EscapeQueryValue(target->query[i].second));
  }
  const auto escaped = gateway::ParseTarget(again);
  Require(escaped.ok() && escaped->query == target->query, "escaped parameters come back");
  gateway::Target taken = *target;
  taken.TakeParameter("token");
  Require(taken.TakeParameter("token").empty(), "a token that was taken out is gone");

  const v1::Dataset dataset = MakeDataset();
  const auto query = gateway::PictureQueryFromQuery(target->query, dataset);
  if (query.ok()) {
    const v1::RenderIsosurfaceRequest* const picture = &query->request;
    Require(picture->dataset() == "head", "a picture is one of the dataset of its address");
    const auto selection = wire::ResolveSelection(picture->selection(), dataset);
    if (selection.ok()) {
      const auto same = wire::ResolveSelection(*selection, dataset);
      Require(same.ok() && same->SerializeAsString() == selection->SerializeAsString(),
              "what a selection means has no open parts");
      Require(!gateway::DependsOnLaterSteps(*selection, dataset), "and stays what it is");
    }
  } else {
    RequireError(query.status(), {absl::StatusCode::kInvalidArgument});
  }
  for (const client::MeshFormat format : {client::MeshFormat::kGlb, client::MeshFormat::kStl}) {
    const auto mesh = gateway::MeshQueryFromQuery(format, target->query, dataset);
    if (!mesh.ok()) {
      RequireError(mesh.status(), {absl::StatusCode::kInvalidArgument});
    }
  }
  ReadHistogram(target->query, dataset);
  ReadFilm(target->query, dataset);
}

void ReadMessage(absl::string_view text) {
  const auto request = gateway::DecodeInteractRequest(text);
  if (!request.ok()) {
    RequireError(request.status(), {absl::StatusCode::kInvalidArgument});
    return;
  }
  Require(request->kind_case() != v1::InteractRequest::KIND_NOT_SET, "a message says something");
  const auto again = gateway::DecodeInteractRequest(gateway::ToJson(*request));
  Require(again.ok(), "a message comes back from its JSON");
}

// Whether it is an address with or without a port: a page can't let a name of its own mean it.
bool IsAddress(absl::string_view host) {
  in6_addr address{};
  if (absl::StrContains(host, '\0')) {
    return false;
  }
  if (absl::ConsumePrefix(&host, "[")) {
    return inet_pton(AF_INET6, std::string(host.substr(0, host.find(']'))).c_str(), &address) == 1;
  }
  return inet_pton(AF_INET, std::string(host.substr(0, host.find(':'))).c_str(), &address) == 1;
}

// Origin, host, token and "Authorization", each a piece.
void ReadSource(Input input) {
  const absl::string_view origin = input.Piece();
  const absl::string_view host = input.Piece();
  const absl::string_view parameter = input.Piece();
  const absl::string_view authorization = input.Piece();
  const gateway::AccessRules open({.listens_on_loopback = true});
  const absl::Status source = open.CheckSource(origin, host);
  if (!source.ok()) {
    RequireError(source, {absl::StatusCode::kPermissionDenied});
  } else {
    Require(gateway::IsLoopback(host) || IsAddress(host),
            "a gateway of this machine is asked by no name but localhost");
  }
  const gateway::AccessRules guarded({.token = "0123456789abcdef0123456789abcdef"});
  const bool knows_token = parameter == "0123456789abcdef0123456789abcdef" ||
                           authorization == "Bearer 0123456789abcdef0123456789abcdef";
  const absl::Status token = guarded.CheckToken(parameter, authorization);
  Require(token.ok() == knows_token || absl::StartsWithIgnoreCase(authorization, "bearer "),
          "only the token opens a gateway");
  if (!token.ok()) {
    RequireError(token, {absl::StatusCode::kUnauthenticated});
  }
  const absl::Status data = open.CheckDataSource(
      {.origin = origin, .host = host, .fetch_site = parameter, .referer = authorization});
  Require(source.ok() || !data.ok(), "data is for nobody who may not see the page");
  Require(gateway::TokenOfProtocols(authorization).size() <= authorization.size(),
          "a token is no longer than the protocol that carries it");
  const auto user = open.UserToken(parameter, authorization);
  Require(!user.ok() || user->empty() || rpc::CheckTokenText(*user).ok(),
          "a token that is passed on may travel in a header");
  const auto parsed = gateway::ParseOrigin(origin);
  if (parsed.ok()) {
    const auto again = gateway::ParseOrigin(*parsed);
    Require(again.ok() && *again == *parsed, "an origin comes back from its text");
  }
}

void Run(Input input) {
  switch (input.Byte() % 4) {
    case 0:
      return ReadTarget(input.Rest());
    case 1:
      return ReadTarget(absl::StrCat("/?", input.Rest()));
    case 2:
      return ReadMessage(input.Rest());
    default:
      return ReadSource(input);
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::string zero(1, '\0');
  return {
      zero + "/v1/datasets/a%2Fb/render?isovalue=60&width=640&token=abc",
      zero + "http://localhost:8080/index.html?a=b&a=c",
      "\1isovalue=60&width=64&height=48&azimuth=30&elevation=-10&zoom=2&fit=surface&"
      "background=1,1,1&samples=4&clip_plane=0,0,1,2&clip-box=0,5,0,5,0,5&color-by=z:turbo&"
      "light=1,1,1:2&ambient-occlusion=&silhouette=3:1,0,0&max_layers=4&culling=none&"
      "region=1,2,30,40&format=jpeg&quality=80",
      "\1surface=60:1,0,0:0.5&surface=70",
      "\2{\"viewState\":{\"sequenceNumber\":\"1\",\"frame\":{\"dataset\":\"head\",\"isovalue\":60,"
      "\"viewport\":{\"widthPx\":64,\"heightPx\":48}},\"targetFramesPerSecond\":30,"
      "\"isAtRest\":true}}",
      "\2{\"frameShown\":{\"frameNumber\":\"7\",\"decodeDuration\":\"0.004s\"}}",
      "\3" + MakePiece("http://localhost:8080") + MakePiece("localhost:8080") + MakePiece("abc") +
          MakePiece("Bearer 0123456789abcdef0123456789abcdef"),
      "\3" + MakePiece("https://hub.example.org") + MakePiece("[::1]:1") + MakePiece("") +
          MakePiece(""),
      "\3" + MakePiece("") + MakePiece("localhost:8080") + MakePiece("cross-site") +
          MakePiece("isoscope, isoscope.bearer.YStiL2M9"),
  };
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
