// isoscope view INPUT... | DIR... | --server HOST:PORT [--isovalue V] [--label SET] [--listen HOST:PORT]
//   [--published HOST:PORT] [--no-open] [--gateway-token-file FILE] [--allow-origin ORIGIN]
// isoscope view INPUT | DIR | --server HOST:PORT [--isovalue V] [--label SET] --terminal
//
// 1. A session connects to the server, or starts a cluster in this process for all inputs.
// 2. The first input is shown; the page lists all. Its isovalue to begin with is chosen from the histogram, unless it or labels are given. A
//    segmentation begins with labels.
// 3. --terminal runs the viewer of this terminal (terminal/terminal_viewer). Otherwise a gateway
//    starts, and a browser opens its page, through a RedirectFile because the address holds a
//    token.
// 4. An interrupt shuts the gateway down, then the session.

#include "client-cli/commands/view_command.h"

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <ostream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include <sys/wait.h>

#include "client-cli/commands/redirect_file.h"
#include "client-cli/output/round_value.h"
#include "client-cli/session/session.h"
#include "client-cli/terminal/show_picture.h"
#include "client-cli/terminal/terminal_viewer.h"
#include "client-cli/terminal/view_labels.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/level_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "rpc/host_port.h"
#include "rpc/transport.h"
#include "web-gateway/gateway_server.h"
#include "web-gateway/http/access.h"
#include "web-gateway/http/url.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// The usual port; another one if it is taken.
constexpr char kFirstAddress[] = "127.0.0.1:8080";
constexpr char kOtherAddress[] = "127.0.0.1:0";
// The time that answers in work may take at the end.
constexpr absl::Duration kClosingGrace = absl::Seconds(2);

struct ViewFlags {
  SessionFlags session;
  std::vector<std::string> inputs;  // moved to `session` before it is used
  std::optional<double> isovalue;
  client::LabelFlags label;
  std::optional<std::string> listen_address;
  std::optional<std::string> published_address;
  std::string gateway_token_file;
  std::vector<std::string> allowed_origins;
  bool has_no_open = false;
  bool is_in_terminal = false;
  std::optional<ShowMode> show;
  client::LevelFlags level;
};

// Returns true if a browser can be opened on the user's desktop.
bool IsDesktop() {
  const auto is_set = [](const char* name) {
    // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
    const char* const value = getenv(name);
    return value != nullptr && *value != '\0';
  };
  return isatty(STDOUT_FILENO) == 1 && (is_set("DISPLAY") || is_set("WAYLAND_DISPLAY"));
}

// Opens a page on disk in the desktop's browser. A failure is ignored, because the address is
// printed in any case.
void OpenBrowser(const std::string& path) {
  std::string program = "xdg-open";
  std::string argument = path;
  std::array<char*, 3> argv = {program.data(), argument.data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t pid = -1;
  if (posix_spawnp(&pid, program.c_str(), &actions, nullptr, argv.data(), environ) == 0) {
    std::thread([pid] { waitpid(pid, nullptr, 0); }).detach();
  }
  posix_spawn_file_actions_destroy(&actions);
}

std::string PortOf(const std::string& address) { return address.substr(address.rfind(':') + 1); }

// A published page is reached from outside, for instance of a container, where the loopback address
// is unreachable.
std::string ListenAddress(const ViewFlags& flags) {
  const std::string unsaid = flags.published_address
                                 ? absl::StrCat("0.0.0.0:", PortOf(*flags.published_address))
                                 : kFirstAddress;
  return flags.listen_address.value_or(unsaid);
}

// With a certificate the page uses https. Without one it stays on this machine, unless --insecure
// is given. A published page relies on its publisher, such as a container engine, for access
// control.
absl::Status CheckListen(const ViewFlags& flags) {
  const rpc::TransportFlags& transport = flags.session.connection.transport;
  if (!transport.certificate_file.empty() || flags.published_address) {
    return absl::OkStatus();
  }
  const absl::Status status =
      rpc::CheckListen({.is_insecure = transport.is_insecure}, ListenAddress(flags));
  return status.ok() ? status : UsageError(status.message());
}

absl::StatusOr<std::unique_ptr<gateway::GatewayServer>> StartGateway(
    const ViewFlags& flags, gateway::GatewayOptions* options) {
  options->listen_address = ListenAddress(flags);
  options->certificate_file = flags.session.connection.transport.certificate_file;
  options->key_file = flags.session.connection.transport.key_file;
  options->access.allowed_origins = flags.allowed_origins;
  // Every user of this machine can reach its loopback address, too.
  ISOSCOPE_ASSIGN_OR_RETURN(options->access.token,
                            gateway::ReadGatewayToken(flags.gateway_token_file));
  if (options->access.token.empty()) {
    options->access.token = gateway::MakeToken();
  }
  absl::StatusOr<std::unique_ptr<gateway::GatewayServer>> server =
      gateway::GatewayServer::Start(*options);
  if (absl::IsUnavailable(server.status()) && !flags.listen_address && !flags.published_address) {
    options->listen_address = kOtherAddress;
    server = gateway::GatewayServer::Start(*options);
  }
  return server;
}

// Returns the address of the page for the user.
std::string PageOf(const ViewFlags& flags, const gateway::GatewayOptions& options, int port,
                   const std::string& token) {
  const bool has_tls = !options.certificate_file.empty();
  int published_port = 0;
  if (flags.published_address &&
      absl::SimpleAtoi(PortOf(*flags.published_address), &published_port) && published_port != 0) {
    return gateway::PageAddress(*flags.published_address, published_port, token, has_tls);
  }
  return gateway::PageAddress(flags.published_address.value_or(options.listen_address), port, token,
                              has_tls);
}

// The surfaces to begin with.
struct FirstSurfaces {
  std::optional<double> isovalue = std::nullopt;
  client::LabelFlags label = {};  // resolved
};

// Chooses what the samples suggest: an isovalue, or labels. The page chooses labels itself, by the
// same suggestion. Without a histogram any isovalue will do: the page can change it.
absl::Status SuggestSurfaces(const ViewFlags& flags, const v1::Dataset& dataset, Session* session,
                             FirstSurfaces* first) {
  v1::GetHistogramRequest request;
  request.set_dataset(dataset.name());
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::GetHistogramResponse histogram,
                            session->client().GetHistogram(request, session->question_timeout()));
  const std::vector<double> labels(histogram.suggested_labels().begin(),
                                   histogram.suggested_labels().end());
  if (labels.empty()) {
    first->isovalue = FirstIsovalue(histogram, dataset);
    return absl::OkStatus();
  }
  if (!flags.is_in_terminal) {
    return absl::OkStatus();
  }
  first->label.wants_all = true;
  return client::ResolveLabels(dataset, labels, &first->label);
}

absl::StatusOr<FirstSurfaces> ChooseSurfaces(const ViewFlags& flags, const v1::Dataset& dataset,
                                             Session* session) {
  FirstSurfaces first{.label = flags.label};
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(
      dataset, /*selection=*/{}, session->frame_timeout(), &session->client(), &first.label));
  first.isovalue = flags.isovalue;
  if (!flags.isovalue && flags.label.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(SuggestSurfaces(flags, dataset, session, &first));
  }
  if (!flags.label.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(client::CheckSurfaces(first.isovalue, /*surfaces=*/{},
                                                   /*color=*/std::nullopt, first.label));
  }
  return first;
}

absl::Status CheckTerminalUsage(const ViewFlags& flags) {
  if (flags.show && !flags.is_in_terminal) {
    return UsageError("--show says how --terminal draws: give that too");
  }
  if (flags.show == ShowMode::kNever) {
    return UsageError("--show never leaves --terminal nothing to do");
  }
  const char* const for_browser = flags.listen_address                ? "--listen"
                                  : !flags.allowed_origins.empty()    ? "--allow-origin"
                                  : flags.has_no_open                 ? "--no-open"
                                  : !flags.gateway_token_file.empty() ? "--gateway-token-file"
                                                                      : nullptr;
  if (flags.is_in_terminal && for_browser != nullptr) {
    return UsageError(
        absl::StrCat("--terminal can't be used with ", for_browser, ", which is for the browser"));
  }
  return absl::OkStatus();
}

// "3,7:0.5,0.25,1:0.4", as the page and --label take it.
std::string TextOf(const client::LabelSurface& surface, const client::LabelValue& given) {
  std::string text = TextOfValues(surface.values);
  if (given.color) {
    absl::StrAppendFormat(&text, ":%.9g,%.9g,%.9g", given.color->red, given.color->green,
                          given.color->blue);
  }
  if (given.opacity) {
    absl::StrAppendFormat(&text, "%s:%.9g", given.color ? "" : ":", *given.opacity);
  }
  return text;
}

// "&max-spacing=1.1", as the page takes it; "" without a choice.
std::string WordsOfLevel(const client::LevelFlags& level) {
  return level.level            ? absl::StrCat("&level=", *level.level)
         : level.max_spacing_px ? absl::StrCat("&max-spacing=", FormatValue(*level.max_spacing_px))
                                : "";
}

// Gives the session the inputs.
absl::Status TakeInputs(ViewFlags* flags) {
  std::vector<std::string>& inputs = flags->inputs;
  for (std::string& input : inputs) {
    if (input.empty()) {
      return UsageError("an input is empty: give a volume or a dataset folder");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(input, ParseSource(input));
  }
  if (flags->is_in_terminal && inputs.size() > 1) {
    return UsageError(absl::StrCat("--terminal shows one input, not ", inputs.size(),
                                   ": give one of them, or leave --terminal out"));
  }
  if (!inputs.empty()) {
    flags->session.input = inputs.front();
    flags->session.more_inputs.assign(inputs.begin() + 1, inputs.end());
  }
  return absl::OkStatus();
}

absl::Status Run(ViewFlags flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(TakeInputs(&flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  ISOSCOPE_RETURN_IF_ERROR(CheckListen(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckTerminalUsage(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.label));
  ISOSCOPE_RETURN_IF_ERROR(client::CheckUsage(flags.level));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, nullptr, view::kCommonViewport, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Dataset dataset, session->GetDataset());
  ISOSCOPE_ASSIGN_OR_RETURN(const FirstSurfaces first,
                            ChooseSurfaces(flags, dataset, session.get()));
  if (flags.is_in_terminal) {
    return RunTerminalViewer(
        dataset, {.isovalue = first.isovalue, .labels = first.label.surfaces, .level = flags.level},
        flags.show.value_or(ShowMode::kAuto), session.get(), context);
  }
  gateway::GatewayOptions options;
  options.channel = session->channel();
  options.coordinator_address = flags.session.server.value_or("");
  options.coordinator_token = session->token();
  if (flags.session.timeout.has_value()) {
    options.limits.max_picture_duration = *flags.session.timeout;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<gateway::GatewayServer> server,
                            StartGateway(flags, &options));
  // Without the token, which GetCapabilities must not reveal.
  session->SetGatewayAddress(PageOf(flags, options, server->port(), /*token=*/""));
  const std::string address =
      absl::StrCat(ViewAddress(PageOf(flags, options, server->port(), options.access.token),
                               dataset.name(), first.isovalue, first.label),
                   WordsOfLevel(flags.level));
  *context.out << address << std::endl;
  if (context.err_is_terminal) {
    *context.err << "the page is at this address until Ctrl-C" << std::endl;
  }
  std::unique_ptr<RedirectFile> redirect;
  if (!flags.has_no_open && IsDesktop()) {
    // Every user of the machine can read command lines, so none has the address.
    absl::StatusOr<std::unique_ptr<RedirectFile>> made = RedirectFile::Create(address);
    if (made.ok()) {
      redirect = *std::move(made);
      OpenBrowser(redirect->path());
    } else {
      *context.err << "no browser was opened: " << made.status().message() << std::endl;
    }
  }
  context.interrupt->Wait();
  const base::OrderlyEnd closes(kClosingGrace + absl::Seconds(5));
  server->Shutdown(kClosingGrace);
  return absl::OkStatus();
}

Action RegisterViewFlags(FlagSet* set) {
  const auto flags = std::make_shared<ViewFlags>();
  AddSessionFlags(set, &flags->session);
  set->Remove("input");  // there may be several
  set->AddTexts("input", "INPUT|DIR", &flags->inputs,
                "a volume, as 'partition' takes it (partitioned into a cache first), or a dataset "
                "folder; several, for the page to change between: --isovalue, --label and "
                "--labels are for the first, flags of volumes for all");
  AddRendererFlag(set, &flags->session);
  AddFlag(
      set, "--isovalue", "V", &flags->isovalue, client::ParseNumber,
      "the isovalue to begin with, in field units (default: one that the samples suggest, unless "
      "labels are given, or the samples are labels)");
  client::AddLabelFlags(set, &flags->label);
  client::AddLevelFlags(set, &flags->level);
  const auto parse_address = [](absl::string_view text) {
    return rpc::ParseAddress(text, rpc::kGatewayPort);
  };
  AddFlag(set, "--listen", "HOST[:PORT]", &flags->listen_address, parse_address,
          absl::StrCat("where the page is; port 0 takes a free one (default: ", kFirstAddress,
                       ", or another port if that is taken)"));
  AddFlag(set, "--published", "HOST[:PORT]", &flags->published_address, parse_address,
          "where people find the page if a container engine or a proxy publishes it: this address "
          "is printed, and --listen is 0.0.0.0 with its port unless given, without --insecure")
      .Environment("ISOSCOPE_VIEW_PUBLISHED");
  set->AddText("--gateway-token-file", "FILE", &flags->gateway_token_file,
               "a file with the token that the page asks for, which its address has (default: "
               "$ISOSCOPE_GATEWAY_TOKEN, the token itself; else a random one)");
  AddRepeatableFlag(set, "--allow-origin", "ORIGIN", &flags->allowed_origins, gateway::ParseOrigin,
                    "pages of this origin may ask for pictures, too, as https://HOST[:PORT]; any "
                    "number of times");
  set->AddSwitch("--no-open", &flags->has_no_open,
                 "do not open a browser; it is opened on a desktop only");
  set->AddSwitch("--terminal", &flags->is_in_terminal,
                 "show it in this terminal instead, turned with the keys: arrows, + - to zoom, [ ] "
                 "for the isovalue, n for the next label alone, ? for all");
  AddShowFlag(set, &flags->show, "how --terminal draws (default: auto, the best it can)");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

double FirstIsovalue(const v1::GetHistogramResponse& histogram, const v1::Dataset& dataset) {
  const bool has_bins = !histogram.bins().empty();
  const double min = has_bins ? histogram.bins(0).min() : dataset.value_range().min();
  const double max =
      has_bins ? histogram.bins(histogram.bins_size() - 1).max() : dataset.value_range().max();
  for (const v1::IsovalueSuggestion& suggestion : histogram.suggestions()) {
    if (suggestion.method() == v1::IsovalueSuggestion::METHOD_BETWEEN_CLASSES) {
      return RoundedValue(suggestion.isovalue(), min, max);
    }
  }
  if (!histogram.suggestions().empty()) {
    return RoundedValue(histogram.suggestions(0).isovalue(), min, max);
  }
  // Halves first: the sum of two large values may be infinite.
  return RoundedValue(dataset.value_range().min() / 2 + dataset.value_range().max() / 2, min, max);
}

std::string ViewAddress(absl::string_view page, const std::string& dataset,
                        const std::optional<double>& isovalue, const client::LabelFlags& label) {
  std::string address = absl::StrCat(page, page.find('?') == absl::string_view::npos ? "?" : "&",
                                     "dataset=", gateway::EscapeQueryValue(dataset));
  if (isovalue) {
    absl::StrAppend(&address, "&isovalue=", gateway::EscapeQueryValue(FormatValue(*isovalue)));
  }
  if (label.wants_all) {
    std::vector<double> values;
    for (const client::LabelSurface& surface : label.surfaces) {
      values.push_back(surface.values[0]);
    }
    absl::StrAppend(&address, "&labels=", gateway::EscapeQueryValue(TextOfValues(values)));
  } else {
    for (std::size_t i = 0; i < label.surfaces.size(); ++i) {
      absl::StrAppend(
          &address, "&label=", gateway::EscapeQueryValue(TextOf(label.surfaces[i], label.sets[i])));
    }
  }
  return label.smooths ? absl::StrCat(address, "&smooth-labels=1") : address;
}

Command ViewCommand() {
  return {.name = "view",
          .summary = "Shows an isosurface to be turned: in the browser, or in the terminal",
          .usage = "INPUT... | DIR... | --server HOST:PORT [OPTIONS]",
          .examples =
              "  isoscope view head.nii.gz\n"
              "  isoscope view head.nii.gz --isovalue 60 --listen 127.0.0.1:9000 --no-open\n"
              "  isoscope view before.nii.gz after.nii.gz\n"
              "  isoscope view --server localhost:50051 --dataset head\n"
              "  isoscope view body.seg.nrrd --labels all\n"
              "  isoscope view head.nii.gz --terminal\n"
              "\nStarts everything in this process and prints the address of the page, alone, on\n"
              "standard output. The address has a token that the page asks for: whoever is to\n"
              "see the page needs it. Ctrl-C ends it.\n",
          .register_flags = RegisterViewFlags};
}

}  // namespace isoscope::cli
