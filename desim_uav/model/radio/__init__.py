"""Radio links: path loss, link budgets, classes of a link, and the rings in which they hold."""

from desim_uav.model.radio import path_loss as path_loss
from desim_uav.model.radio import three_gpp as three_gpp
