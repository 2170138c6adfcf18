// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace rig {

/// Text as it stands between HTML tags.
[[nodiscard]] inline std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else
      out += c;
  }
  return out;
}

/// How pages look that stand alone, in a browser and printed.
[[nodiscard]] inline std::string page_style() {
  return "body{font:15px/1.45 \"Source Sans 3\",\"DejaVu "
         "Sans\",sans-serif;color:#1a1a1a;max-width:52rem;margin:2rem "
         "auto;padding:0 1.2rem}h1{font-size:1.7rem}h2{font-size:1.2rem;margin-top:2rem;border-bottom:2px "
         "solid "
         "#1a1a1a}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}th,td{text-"
         "align:left;"
         "padding:.28rem .6rem .28rem 0;border-bottom:1px solid "
         "#cfcfcf}td.n,th.n{text-align:right}.sub{color:#5a5a5a;"
         "font-weight:400;font-size:.9rem}.box{border-left:.3rem solid #006d4c;padding:.3rem "
         ".9rem;background:#f7f7f5}"
         "figure{margin:1rem 0}figure "
         "svg{max-width:100%;height:auto}figcaption{color:#5a5a5a;font-size:.9rem}"
         "@page{size:A4;margin:18mm 16mm}@media print{figure,table,.box{break-inside:avoid}}";
}

}  // namespace rig
