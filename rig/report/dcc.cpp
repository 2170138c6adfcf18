// SPDX-License-Identifier: MIT
#include "rig/report/dcc.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/html_text.hpp"
#include "rig/session/session_dates.hpp"

namespace rig {
namespace {

using json = nlohmann::json;

/// Elements one inside the other, indented.
class Xml {
 public:
  explicit Xml(std::string& out) : out_(out) {}
  template <class Inside>
  void element(const std::string& name, const Inside& inside, const std::string& attributes = "") {
    line("<" + name + (attributes.empty() ? "" : " " + attributes) + ">");
    ++depth_;
    inside();
    --depth_;
    line("</" + name + ">");
  }
  void leaf(const std::string& name, const std::string& text, const std::string& attributes = "") {
    line("<" + name + (attributes.empty() ? "" : " " + attributes) + ">" + escaped(printable(text)) + "</" +
         name + ">");
  }
  /// dcc:textType and dcc:richContentType.
  void words(const std::string& name, const std::string& text) {
    element(name, [&] { leaf("dcc:content", text, "lang=\"en\""); });
  }

 private:
  /// Without the control characters that XML 1.0 does not know.
  static std::string printable(std::string text) {
    std::erase_if(text,
                  [](char c) { return static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t'; });
    return text;
  }
  void line(const std::string& text) { out_ += std::string(2 * depth_, ' ') + text + "\n"; }
  std::string& out_;
  std::size_t depth_ = 0;
};

/// The schema's text that is not empty: words with single spaces, none at its ends.
std::string trimmed(const std::string& text, const std::string& otherwise = "not stated") {
  std::string out;
  for (const char c : text)
    if (!std::isspace(static_cast<unsigned char>(c)))
      out += c;
    else if (!out.empty() && out.back() != ' ')
      out += ' ';
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out.empty() ? otherwise : out;
}

/// D-SI's name of a unit (BIPM's SI Brochure in the manner of siunitx).
std::string d_si_unit(const std::string& unit) {
  if (unit == "mm") return "\\milli\\metre";
  if (unit == "deg") return "\\degree";
  if (unit == "%") return "\\percent";
  if (unit == "s") return "\\second";
  if (unit == "deg/s") return "\\degree\\second\\tothe{-1}";
  return "\\one";
}

std::string date_of(const std::string& utc) { return utc.size() >= 10 ? utc.substr(0, 10) : "1970-01-01"; }

std::string country_of(const json& laboratory) {
  const std::string stated = text_of(laboratory, "country");
  return stated.size() == 2 && std::isupper(static_cast<unsigned char>(stated[0])) &&
                 std::isupper(static_cast<unsigned char>(stated[1]))
             ? stated
             : "ZZ";  // User-assigned in ISO 3166: not stated.
}

std::string decimal(double value) { return fit::format_exactly(value == 0 ? 0.0 : value); }

/// What the schema accepts as a coverage factor: from 1, without a power of ten.
std::string factor(double k) { return fit::format_fixed(std::max(1.0, k), 3); }

void contact(Xml& xml, const std::string& element, const std::string& name, const std::string& address) {
  xml.element(element, [&] {
    xml.words("dcc:name", trimmed(name));
    xml.element("dcc:location", [&] { xml.words("dcc:further", trimmed(address)); });
  });
}

void identification(Xml& xml, const std::string& issuer, const std::string& value, const std::string& name) {
  xml.element("dcc:identification", [&] {
    xml.leaf("dcc:issuer", issuer);
    xml.leaf("dcc:value", trimmed(value));
    xml.words("dcc:name", name);
  });
}

void software(Xml& xml, const std::string& name) {
  const std::size_t space = name.find(' ');
  xml.element("dcc:software", [&] {
    xml.words("dcc:name", trimmed(name.substr(0, space)));
    xml.leaf("dcc:release", trimmed(space == std::string::npos ? "" : name.substr(space + 1)));
    xml.leaf("dcc:type", "application");
  });
}

void core_data(Xml& xml, const json& certificate, const json& laboratory) {
  xml.element("dcc:coreData", [&] {
    xml.leaf("dcc:countryCodeISO3166_1", country_of(laboratory));
    xml.leaf("dcc:usedLangCodeISO639_1", "en");
    xml.leaf("dcc:mandatoryLangCodeISO639_1", "en");
    xml.leaf("dcc:uniqueIdentifier", trimmed(text_of(certificate, "number")));
    xml.element("dcc:identifications", [&] {
      identification(xml, "calibrationLaboratory", text_of(certificate, "sha256"), "SHA-256 of the data");
    });
    if (const std::string received = text_of(laboratory, "received");
        !received.empty() && received == date_in(received))
      xml.leaf("dcc:receiptDate", received);
    const std::string measured =
        date_of(text_of(certificate, "measured_utc", text_of(certificate, "created_utc")));
    xml.leaf("dcc:beginPerformanceDate", measured);
    xml.leaf("dcc:endPerformanceDate", measured);
    xml.leaf("dcc:performanceLocation", "laboratory");
    xml.leaf("dcc:issueDate", date_of(text_of(certificate, "issued_utc")));
    if (const std::string replaced = text_of(certificate, "replaces"); !replaced.empty())
      xml.element("dcc:reportAmendedSubstituted", [&] {
        xml.leaf("dcc:typeOfChange", "amended");
        xml.leaf("dcc:replacedUniqueIdentifier", trimmed(replaced));
      });
  });
}

void statement(Xml& xml, const std::string& name, const std::string& declaration) {
  xml.element("dcc:statement", [&] {
    xml.words("dcc:name", name);
    xml.words("dcc:declaration", declaration);
  });
}

void statements(Xml& xml, const json& certificate) {
  xml.element("dcc:statements", [&] {
    if (!certificate.value("certifies", true)) {
      std::string why;
      for (const json& reason : list_of(certificate, "not_certified_because"))
        if (reason.is_string()) why += " " + reason.get<std::string>();
      statement(xml, text_of(certificate, "title"), "This is a report, not a certificate:" + why);
    }
    statement(xml, "Validity",
              "The results relate only to the item calibrated, at the time and under the conditions stated.");
    statement(xml, "Reproduction",
              "Not to be reproduced except in full without the approval of the laboratory.");
    statement(xml, "Adjustment", trimmed(text_of(certificate, "adjustment")));
    const json limits = certificate.value("limits", json::object());
    for (const json& check : list_of(limits, "checks"))
      xml.element("dcc:statement", [&] {
        xml.words("dcc:name", trimmed(text_of(check, "label", text_of(check, "name"))));
        xml.leaf("dcc:convention", trimmed(text_of(limits, "rule"), "simple acceptance"));
        xml.words("dcc:declaration", trimmed(text_of(check, "text"), "see the results"));
        const std::string verdict = text_of(check, "verdict");
        if (verdict == "pass" || verdict == "fail") xml.leaf("dcc:conformity", verdict);
      });
  });
}

void administrative_data(Xml& xml, const json& certificate) {
  const json laboratory = certificate.value("laboratory", json::object()),
             item = certificate.value("item", json::object());
  xml.element("dcc:administrativeData", [&] {
    xml.element("dcc:dccSoftware", [&] { software(xml, text_of(certificate, "software")); });
    core_data(xml, certificate, laboratory);
    xml.element("dcc:items", [&] {
      xml.element("dcc:item", [&] {
        xml.words("dcc:name", trimmed(text_of(laboratory, "item"), trimmed(text_of(item, "model"))));
        xml.leaf("dcc:model", trimmed(text_of(item, "model")));
        xml.element("dcc:identifications", [&] {
          identification(xml, "manufacturer", text_of(item, "serial"), "Serial number");
          identification(xml, "manufacturer", text_of(item, "firmware"), "Firmware");
        });
      });
    });
    xml.element("dcc:calibrationLaboratory", [&] {
      contact(xml, "dcc:contact", text_of(laboratory, "laboratory"),
              text_of(laboratory, "address", text_of(laboratory, "place")));
    });
    xml.element("dcc:respPersons", [&] {
      xml.element("dcc:respPerson", [&] {
        xml.element("dcc:person",
                    [&] { xml.words("dcc:name", trimmed(text_of(laboratory, "authorised_by"))); });
        xml.leaf("dcc:mainSigner", "true");
      });
    });
    contact(xml, "dcc:customer", text_of(laboratory, "customer"), text_of(laboratory, "customer_address"));
    statements(xml, certificate);
  });
}

bool has_uncertainty(const json& value) {
  return value.is_object() && std::isfinite(number_of(value, "value")) &&
         std::isfinite(number_of(value, "U")) && number_of(value, "U") > 0;
}

void quantity(Xml& xml, const json& value) {
  const std::string unit = text_of(value, "unit");
  xml.element("dcc:result", [&] {
    xml.words("dcc:name", trimmed(text_of(value, "label", text_of(value, "name"))));
    xml.element("dcc:data", [&] {
      xml.element("dcc:quantity", [&] {
        xml.element("si:real", [&] {
          xml.leaf("si:label", text_of(value, "name"));
          xml.leaf("si:value", decimal(number_of(value, "value")));
          xml.leaf("si:unit", d_si_unit(unit));
          if (!has_uncertainty(value)) return;
          xml.element("si:expandedUnc", [&] {
            xml.leaf("si:uncertainty", decimal(number_of(value, "U")));
            xml.leaf("si:coverageFactor", factor(number_of(value, "k", 2)));
            xml.leaf("si:coverageProbability", "0.95");
            xml.leaf("si:distribution", number_of(value, "nu_eff", 0) > 0 ? "Student" : "normal");
          });
        });
      });
    });
  });
}

void conditions(Xml& xml, const json& certificate) {
  const json all = list_of(certificate, "conditions");
  if (all.empty()) return;
  xml.element("dcc:influenceConditions", [&] {
    for (const json& condition : all)
      xml.element("dcc:influenceCondition", [&] {
        xml.words("dcc:name", trimmed(text_of(condition, "name")));
        xml.element("dcc:data", [&] { xml.words("dcc:text", trimmed(text_of(condition, "text"))); });
      });
  });
}

void equipment(Xml& xml, const json& certificate) {
  const json all = list_of(certificate, "equipment");
  if (all.empty()) return;
  xml.element("dcc:measuringEquipments", [&] {
    for (const json& item : all)
      xml.element("dcc:measuringEquipment", [&] {
        xml.words("dcc:name", trimmed(text_of(item, "name")));
        xml.words("dcc:description", "Certificate " + trimmed(text_of(item, "certificate")) + ", due " +
                                         trimmed(text_of(item, "due")));
        xml.element("dcc:identifications",
                    [&] { identification(xml, "manufacturer", text_of(item, "serial"), "Serial number"); });
      });
  });
}

void measurement_results(Xml& xml, const json& certificate) {
  xml.element("dcc:measurementResults", [&] {
    bool any = false;
    for (const json& entry : list_of(certificate, "results")) {
      const json result = entry.value("result", json::object());
      json values = json::array();
      for (const json& value : list_of(result, "values"))
        if (value.is_object() && std::isfinite(number_of(value, "value"))) values.push_back(value);
      if (values.empty()) continue;
      any = true;
      xml.element("dcc:measurementResult", [&] {
        xml.words("dcc:name", trimmed(text_of(result, "title", text_of(entry, "kind"))));
        xml.element("dcc:usedMethods", [&] {
          xml.element("dcc:usedMethod", [&] {
            xml.words("dcc:name", trimmed(text_of(certificate, "procedure"), text_of(entry, "kind")));
            xml.words("dcc:description", trimmed(text_of(result, "method")));
          });
        });
        xml.element("dcc:usedSoftware", [&] { software(xml, text_of(certificate, "software")); });
        equipment(xml, certificate);
        conditions(xml, certificate);
        xml.element("dcc:results", [&] {
          for (const json& value : values) quantity(xml, value);
        });
      });
    }
    if (any) return;
    // The schema asks for one.
    xml.element("dcc:measurementResult", [&] {
      xml.words("dcc:name", "No calibration");
      xml.element("dcc:results", [&] {
        xml.element("dcc:result", [&] {
          xml.words("dcc:name", "No result");
          xml.element("dcc:data", [&] { xml.words("dcc:text", "The session holds no calibration."); });
        });
      });
    });
  });
}

}  // namespace

std::string to_dcc(const json& certificate) {
  std::string out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  Xml xml(out);
  xml.element(
      "dcc:digitalCalibrationCertificate",
      [&] {
        administrative_data(xml, certificate);
        measurement_results(xml, certificate);
      },
      "xmlns:dcc=\"https://ptb.de/dcc\" xmlns:si=\"https://ptb.de/si\" schemaVersion=\"3.2.1\"");
  return out;
}

}  // namespace rig
