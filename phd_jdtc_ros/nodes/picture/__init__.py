"""A live picture of the traffic in a browser.

::

    topics of the tracker      node
      |  as JSON                updates
    events                     server: pages, clients that are dropped if they do not read
      |
    the page's map             report/page/assets, with live.js in the place of page.js
"""
