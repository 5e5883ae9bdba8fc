"""Who is who at a site: identities, and the site's own certificate authority.

What an identity may send is in `protocol/messages/rights.py`.
"""
