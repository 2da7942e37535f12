"""Contact laws: vectorised functions with analytic derivatives, and the Drake systems that apply them."""

from drake_cafim.contact.law import ContactDerivatives, ContactLaw, ContactParameters
from drake_cafim.contact.normal import NORMAL_LAWS, NormalLaw

__all__ = ["NORMAL_LAWS", "ContactDerivatives", "ContactLaw", "ContactParameters", "NormalLaw"]
