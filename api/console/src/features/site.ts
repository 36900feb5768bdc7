/** The site: its areas in the scene, and a panel that shows and edits them. */

import { SiteLayer } from "../site/layer";
import { sitePanel } from "../site/panel";
import { t } from "../site/texts";
import type { Feature } from "./feature";

export const site: Feature = {
  panel: { name: "feature-site", title: t.title, icon: "site", view: sitePanel },
  layer: (shared, into) => new SiteLayer(shared, into),
  isRead: ({ features }) => features.site !== null,
};
